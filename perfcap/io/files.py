"""Opening files that somebody else made: bounded, and refused in one line."""

from __future__ import annotations

import json
import re
import tomllib
from os import PathLike, fsdecode
from pathlib import Path
from stat import S_ISREG
from typing import Any

from perfcap.errors import InputError

MEBIBYTE = 2**20
JSON_LIMIT = 512 * MEBIBYTE
TEXT_LIMIT = 64 * MEBIBYTE
_PLENTY = 1024 * MEBIBYTE  # of values in memory, and three times their text
_TAKEN = {"{": 184, "[": 88, ",": 32}  # bytes: an object, a list, a number and its place
VIDEO_SUFFIXES = frozenset(
    {".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".mts", ".wmv"}
)


def named_path(value: object, name: str, what: str) -> Path:
    """The path that a caller names; an empty name is none, as it would be where they are.

    Args:
        value: as it was given.
        name: of the argument.
        what: was expected.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(value, str | PathLike):
        raise InputError(f"{name}: got a {type(value).__name__}, expected the name of {what}")
    if not value:
        raise InputError(f"{name}: is empty, expected the name of {what}")
    return Path(fsdecode(value))


def require_file(path: Path, limit: int, what: str) -> None:
    """Refuse a path that is no file, is empty, or is larger than ``limit`` bytes."""
    try:
        about = path.stat()
    except (FileNotFoundError, NotADirectoryError, ValueError):  # a name with a zero in it
        raise InputError(f"{path}: no such file; expected {what}") from None
    except OSError as error:  # a name that is too long, a folder that may not be entered
        raise InputError(f"{path}: cannot be opened ({error.strerror}); expected {what}") from None
    if not S_ISREG(about.st_mode):
        raise InputError(f"{path}: is not a file; expected {what}")
    size = about.st_size
    if size == 0:
        raise InputError(f"{path}: is empty (0 bytes); expected {what}; write or copy it again")
    if size > limit:
        raise InputError(
            f"{path}: is {size / MEBIBYTE:.0f} MB, the limit for {what} is "
            f"{limit / MEBIBYTE:.0f} MB; split it"
        )


def is_file(path: Path) -> bool:
    """Whether a file lies there; nothing does where the name is none that a file may have."""
    try:
        return path.is_file()
    except OSError:  # it is too long, or in a folder that may not be entered
        return False


def read_text(path: Path, what: str, limit: int = TEXT_LIMIT) -> str:
    """The text of a UTF-8 file, with or without a byte-order mark."""
    require_file(path, limit, what)
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not UTF-8 text (byte {error.start}); expected {what}"
        ) from error


def read_json(path: Path, what: str, limit: int = JSON_LIMIT) -> Any:
    """The value of a JSON file. ``NaN`` and ``Infinity`` are read, as detectors write them."""
    text = read_text(path, what, limit)  # refused by itself: an InputError is a ValueError
    _require_modest(path, text, what)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}: is not valid JSON (line {error.lineno}: {error.msg}); expected {what}; "
            "the file may be cut short, write it again"
        ) from error
    except RecursionError as error:
        raise InputError(f"{path}: JSON nested too deep; expected {what}") from error
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"{path}: is not usable JSON ({error}); expected {what}") from error


def _require_modest(path: Path, text: str, what: str) -> None:
    """Refuse JSON whose values take far more memory than their text: brackets and little else."""
    taken = sum(size * text.count(mark) for mark, size in _TAKEN.items())
    if taken > _PLENTY + 3 * len(text):
        raise InputError(
            f"{path}: {len(text) / MEBIBYTE:.0f} MB of JSON hold {text.count('{')} objects and "
            f"{text.count('[')} lists, {taken / MEBIBYTE:.0f} MB in memory; expected {what}; "
            "split it"
        )


def read_toml(path: Path, what: str, limit: int = TEXT_LIMIT) -> dict[str, Any]:
    """The values of a TOML file."""
    text = read_text(path, what, limit)  # its own refusal is a ValueError, too
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{path}: is nested too deep; expected {what}") from None
    except ValueError as error:
        raise InputError(f"{path}: is not TOML ({error}); expected {what}") from None


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sort key under which ``frame2`` comes before ``frame10``."""
    parts = re.split(r"(\d+)", name)
    return [(0, int(p), "") if p.isdigit() and p.isascii() else (1, 0, p.lower()) for p in parts]


def known_file(folder: Path, text: str) -> Path:
    """A file by the name a capture knew it under, from here or from the result's folder.

    Args:
        folder: of the result.
        text: the name in its report, as it was given.
    """
    beside = folder / text
    return beside if not Path(text).exists() and beside.exists() else Path(text)
