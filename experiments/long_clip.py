"""Time a frame and memory of the pose stages on clips up to seven minutes long.

The motion is random, of perfcap's own skeleton, and so are the headings; detections have swaps,
outliers and depth flips. Time a frame and memory above the inputs and the result should not grow
with the length of the clip. One thread; process CPU time.
"""

from __future__ import annotations

import resource
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import report
import torch
from report import Report, Table
from window_motion import default_skeleton, random_landmarks
from window_problem import Sequence, bare_actor, observe

from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare
from perfcap.pipeline.track_twice import track_twice

_RATE = 30.0
_PART = 300  # frames of a random motion; a clip repeats such parts
_COLUMNS = (
    "frames", "prepare, ms", "initialize, ms", "track, ms", "steps, mean", "peak, MiB",
    "result, MiB",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    frames: tuple[int, ...] = (3150, 6300, 12600)
    """Lengths of clips."""
    seed: int = 0
    """Of motion, heading and noise."""


def run(config: Experiment) -> Report:
    """Capture the same motion for longer and longer."""
    torch.set_num_threads(1)
    _row(_clip(100, config.seed))  # compiles kernels
    rows = tuple(_row(_clip(frames, config.seed)) for frames in config.frames)
    return Report((Table("CPU ms a frame, and memory above the inputs", _COLUMNS, rows, 2),))


def _clip(frames: int, seed: int) -> Sequence:
    rng = np.random.default_rng(seed)
    actor = bare_actor(default_skeleton())
    parts = [random_landmarks(actor.skeleton, _PART, rng) for _ in range(-(-frames // _PART))]
    return observe(f"{frames}", actor, torch.cat(parts)[:frames], rng)


def _row(clip: Sequence) -> tuple[object, ...]:
    frames = clip.detections.frame_count
    known = FrameProblem.of(clip.actor, clip.cameras, clip.detections)
    clocks = [time.process_time()]
    with Memory() as memory:
        prepared = prepare(known)
        clocks.append(time.process_time())
        initial, _ = initialize(prepared)
        clocks.append(time.process_time())
        motion, windows, _ = track_twice(ClipProblem.of(prepared.problem, _RATE), initial)
        clocks.append(time.process_time())
    each = [1e3 * span / frames for span in np.diff(clocks).tolist()]
    steps = sum(window.steps for window in windows) / len(windows)
    result = sum(part.nbytes for part in (motion.translation, motion.rotation, motion.angles))
    return frames, *each, steps, memory.peak / 2**20, result / 2**20


class Memory:
    """Peak resident memory above that at the start, in bytes, sampled from a thread."""

    def __enter__(self) -> Self:
        self.start, self.peak, self.stop = _resident(), 0, threading.Event()
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        self.thread.join()

    def _watch(self) -> None:
        while not self.stop.wait(0.02):
            self.peak = max(self.peak, _resident() - self.start)


def _resident() -> int:
    """Bytes of the process in main memory; where Linux does not tell, the most there ever were."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


if __name__ == "__main__":
    report.main(run, Experiment, "long_clip")
