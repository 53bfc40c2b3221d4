"""The one exception users see for bad input, and text that is safe to print."""

from __future__ import annotations

LONGEST = 1600  # letters of a message
_HEAD = 1000  # of which these come from its beginning, where the file is named


class InputError(ValueError):
    """A file, argument or array that cannot be used.

    The message is one line: what it is about (a path, an argument), what was found, what was
    expected, and what to do. The command line prints it as it is and exits with code 2. Whatever
    it quotes, it is one printable line of bounded length.
    """

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


def one_line(text: str) -> str:
    r"""Printable text of at most ``LONGEST`` letters; what is left out of its middle is counted.

    Example:
        >>> one_line("a\x1b[31m b")
        'a\\x1b[31m b'
    """
    if len(text) > LONGEST:
        left_out = len(text) - LONGEST
        text = f"{text[:_HEAD]} [... {left_out} letters ...] {text[_HEAD + left_out :]}"
    return printable(text)


def printable(text: str, keep: str = "") -> str:
    """Text whose control characters, but those to ``keep``, are written as Python escapes them."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else _escaped(c) for c in text)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


def sentence(error: BaseException) -> str | None:
    """What to tell a user of an error that is nobody's mistake in the program; None of others.

    Bad input, and what any call can meet: little memory, a refusing disk, input nested too deep.
    """
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, RecursionError):
        return "the input is nested too deep; expected at most some hundred levels"
    if _is_short_of_memory(error):
        reason = str(error).strip().partition("\n")[0]
        return one_line(
            f"there is not enough memory ({reason or type(error).__name__}); capture a part with "
            "--frames, or give the machine more"
        )
    if isinstance(error, OSError):
        places = [str(place) for place in (error.filename, error.filename2) if place is not None]
        reason = error.strerror or str(error) or type(error).__name__
        return one_line(f"{' -> '.join(places) or 'the system'}: cannot be used ({reason})")
    return None


_NO_MEMORY = ("allocate memory", "out of memory", "not enough memory", "insufficient memory")
_NO_THREAD = "can't start new thread"


def _is_short_of_memory(error: BaseException) -> bool:
    """Libraries say it in words of their own."""
    if isinstance(error, MemoryError):
        return True
    words = str(error).lower()
    return isinstance(error, RuntimeError | ImportError | OSError) and (
        _NO_THREAD in words or any(each in words for each in _NO_MEMORY)
    )
