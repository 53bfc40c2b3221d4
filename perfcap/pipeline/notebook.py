"""Progress inside a notebook, where nobody asked for another."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

_PAUSE = 0.2  # s between two changes of the cell


def notebook_progress() -> Callable[[str, int, int], None] | None:
    """What shows how far each stage is below the cell that runs; None outside of notebooks."""
    python = sys.modules.get("IPython")
    shell = None if python is None else python.get_ipython()
    if shell is None or not hasattr(shell, "kernel"):
        return None
    return _Cell(sys.modules["IPython"].display.display)


class _Cell:
    """One line that changes: the stages so far, and how far the last one is."""

    def __init__(self, display: Callable[..., Any]) -> None:
        self._display = display
        self._handle: Any = None
        self._stages: dict[str, tuple[int, int]] = {}
        self._changed = -_PAUSE

    def __call__(self, stage: str, done: int, total: int) -> None:
        self._stages[stage] = done, total
        now = time.monotonic()
        if now - self._changed < _PAUSE and done < total:
            return
        self._changed = now
        if self._handle is None:
            self._handle = self._display(self, display_id=True)
        else:
            self._handle.update(self)

    def __repr__(self) -> str:
        parts = [
            name if done >= total else f"{name} {done} of {total}"
            for name, (done, total) in self._stages.items()
        ]
        return "perfcap: " + ", ".join(parts)
