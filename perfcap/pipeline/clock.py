"""What the stages of a capture take, and who is told, in notebooks too."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from perfcap.pipeline.performance import StageReport

# called with a stage's name, what is done and what there is to do
Progress = Callable[[str, int, int], None]


@dataclass
class Clock:
    """Times stages and tells that they start and end."""

    tell: Progress
    stages: list[StageReport] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[int, int], None]]:
        """Time a stage; gives what to tell its progress to."""
        self.tell(name, 0, 1)
        wall, cpu = time.perf_counter(), time.process_time()
        yield partial(self.tell, name)
        self.stages.append(StageReport(name, time.perf_counter() - wall, time.process_time() - cpu))
        self.tell(name, 1, 1)


@contextmanager
def shared_stage(
    clocks: Sequence[Clock], tell: Progress, name: str
) -> Iterator[Callable[[int, int], None]]:
    """Time a stage of everybody: each one's clock is given an equal share."""
    own = Clock(tell)
    with own.stage(name) as told:
        yield told
    (found,) = own.stages
    for each in clocks:
        share = StageReport(name, found.wall / len(clocks), found.cpu / len(clocks))
        each.stages.append(share)


# --- Progress inside a notebook, where nobody asked for another -----------------------------------

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
