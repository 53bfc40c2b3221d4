"""The terminal: plain text as it is, and progress bars for people only."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from perfcap.errors import printable


class PlainConsole(Console):
    """Prints strings letter for letter: names of files and texts in them are never markup."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Also cells of tables come through here."""
        options |= {"markup": False, "emoji": False, "highlight": False}
        return super().render_str(printable(text, keep="\n"), **options)


@contextmanager
def progress_bars() -> Iterator[Callable[[str, int, int], None]]:
    """A function to tell stages to; draws nothing when the error stream is not a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<14}"), BarColumn(), TimeElapsedColumn())
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:

        def tell(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield tell
