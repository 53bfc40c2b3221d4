"""What the stages of a capture take, and who is told."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

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
