"""What a command says while it runs, for the result that it writes."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from perfcap.errors import one_line


@contextmanager
def hearing() -> Iterator[list[str]]:
    """Every warning that is printed from here on, each once, in a list that grows.

    Reading an actor, or following a person through a view, has no place in its result for what it
    says; but whoever reads tables of many captures does not see what was printed.
    """
    heard = _Heard()
    logger = logging.getLogger("perfcap")
    logger.addHandler(heard)
    try:
        yield heard.lines
    finally:
        logger.removeHandler(heard)


def all_said(heard: Sequence[str], *kept: str) -> tuple[str, ...]:
    """What was printed, and what is kept anyway, each once."""
    return (*heard, *(line for line in dict.fromkeys(kept) if one_line(line) not in heard))


class _Heard(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        line = one_line(record.getMessage())
        if line not in self.lines:
            self.lines.append(line)
