"""What users see of errors: one printable line of bounded length, and no tracebacks."""

import errno
import os
from pathlib import Path

import pytest

from perfcap.errors import LONGEST, InputError, one_line, printable, sentence


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("plain é 漢字", "plain é 漢字"),
        ("a\x1b[31mred\x07", r"a\x1b[31mred\x07"),
        ("two\nlines\r", r"two\nlines\r"),
        ("right to left \u202e", r"right to left \u202e"),
        ("no letter \udc80", r"no letter \udc80"),
    ],
)
def test_control_characters_are_escaped(given: str, shown: str) -> None:
    assert str(InputError(given)) == one_line(given) == shown
    shown.encode("utf-8")


def test_long_messages_keep_their_ends() -> None:
    text = str(InputError("file.json: is " + "x" * 100_000 + "; expected a number"))
    assert text.startswith("file.json: is xxx") and text.endswith("xxx; expected a number")
    assert len(text) < LONGEST + 40 and "98433 letters" in text


def test_line_breaks_may_be_kept() -> None:
    assert printable("a\nb\x07", keep="\n") == "a\nb\\x07"


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (InputError("a: is b"), "a: is b"),
        (MemoryError(), "not enough memory (MemoryError)"),
        (RuntimeError("[x] DefaultCPUAllocator: can't allocate memory: you\nat"), "not enough mem"),
        (RuntimeError("can't start new thread"), "not enough memory"),
        (ImportError("libx.so: cannot allocate memory in static TLS block"), "not enough memory"),
        (RecursionError("maximum recursion depth exceeded"), "nested too deep"),
        (OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG), "x" * 5000), "too long"),
        (OSError(errno.EXDEV, "Invalid link", "a", None, "b"), "a -> b: cannot be used (Invalid"),
        (OSError("libavcodec says no"), "the system: cannot be used (libavcodec says no)"),
    ],
)
def test_what_any_call_can_meet_is_a_sentence(error: BaseException, words: str) -> None:
    told = sentence(error)
    assert told is not None and words in told and "\n" not in told


@pytest.mark.parametrize("error", [KeyError("x"), RuntimeError("boom"), ImportError("no module")])
def test_mistakes_of_the_program_are_not_hidden(error: BaseException) -> None:
    assert sentence(error) is None


def test_every_terminal_is_the_plain_one() -> None:
    """One place decides what may reach a terminal."""
    source = Path(__file__).parents[1] / "perfcap"
    users = [p.name for p in source.rglob("*.py") if "rich.console" in p.read_text("utf-8")]
    assert users == ["console.py"]
