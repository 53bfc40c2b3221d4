"""The terminal: plain text as it is, and progress for people and for logs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from perfcap.errors import printable

_SILENCE = 10.0  # seconds between lines where there is no terminal


class PlainConsole(Console):
    """Prints strings letter for letter: names of files and texts in them are never markup."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Also cells of tables come through here."""
        options |= {"markup": False, "emoji": False, "highlight": False}
        return super().render_str(printable(text, keep="\n"), **options)


def print_written(path: Path, replaced: bool = False) -> None:
    """Name a file that was written; say so where an older one, which may be the user's, went."""
    older = " (replaces an older file)" if replaced else ""
    PlainConsole().print(f"{path}{older}", soft_wrap=True)


@contextmanager
def progress_bars() -> Iterator[Callable[[str, int, int], None]]:
    """A function to tell stages to: bars with counts and the time left, or lines in a log.

    Where the error stream is not a terminal, a line comes every ten seconds, none for stages that
    are done sooner.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield Lines(lambda line: console.out(line, highlight=False)).tell
        return
    columns = (
        TextColumn("{task.description:<14}"),
        *(BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()),
    )
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=console) as bars:

        def tell(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield tell


@dataclass
class Lines:
    """Progress as plain lines, few enough for a log.

    Attributes:
        write: takes a line.
        clock: seconds.
    """

    write: Callable[[str], None]
    clock: Callable[[], float] = time.monotonic
    _stage: str = ""
    _started: float = 0.0
    _told: float = 0.0

    def tell(self, stage: str, done: int, total: int) -> None:
        """Say how far a stage is, unless that was said a moment ago."""
        now = self.clock()
        if stage != self._stage:
            self._stage, self._started, self._told = stage, now, now
        if now - self._told < _SILENCE:
            return
        self._told = now
        line = f"perfcap: {stage} {done} of {total}"
        if 0 < done < total:
            left = (now - self._started) * (total - done) / done
            line += f", about {_spelled(left)} left"
        self.write(line)


def _spelled(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 100 else f"{minutes / 60:.1f} h"
