"""Time of the stages that look at images, a frame of 1000x1000 pixels.

A rendered sequence with its images and cameras enlarged to exactly that size. The first capture of
a process also compiles kernels and does not count. Wall time is what a user waits, on as many
workers as there are cores of the machine meant; CPU time is that of the whole process. Both are
medians over repeats of the same capture, and other programs on the same cores lengthen both.
"""

from __future__ import annotations

import cProfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from recordings import Recording, rendered
from report import Report, Table
from surface_recordings import clip_of

from perfcap.geometry.camera import Camera
from perfcap.io.calibration import PixelMap
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import StageReport

_STAGES = ("extract_silhouettes", "refine_pose", "extract_silhouettes_again", "refine_surface")
_WARM = 4  # frames of the first capture
_AIM = 400  # ms a frame


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_tight", "dev_skirt")
    """Of ``rendered``."""
    size: int = 1000
    """Side of the square image, px."""
    frames: int = 40
    """From the first of the sequence."""
    repeats: int = 3
    """Captures whose median counts."""
    workers: int = 2
    """Threads of the stages."""
    profile: Path | None = None
    """Keep what cProfile says of one more capture on one worker, for ``snakeviz`` or ``pstats``."""


@dataclass(frozen=True)
class Kept:
    """Frames of one view in memory: decoding and enlarging are not what is timed."""

    frames: Frames

    def __len__(self) -> int:
        return len(self.frames)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        """A reader's only method."""
        return self.frames[start:stop]


def run(config: Experiment) -> Report:
    """Time every sequence."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    columns = ("stage", "wall, ms", "least", "most", "CPU, ms")
    tables = []
    for name in config.sequences:
        recording = rendered(config.data, name)
        images = enlarged(recording, config.size, config.frames)
        _timed(recording, images, _WARM, config.workers)
        runs = [
            _timed(recording, images, config.frames, config.workers) for _ in range(config.repeats)
        ]
        if config.profile is not None:
            _profile(recording, images, config)
        tables.append(Table(f"{name}, ms a frame", columns, _rows(runs, config.frames)))
    size, workers = config.size, config.workers
    note = f"{config.frames} frames of {size}x{size}, {workers} workers; the aim is {_AIM} ms wall."
    return Report(tuple(tables), (note,))


def enlarged(recording: Recording, side: int, count: int) -> Images:
    """The first frames of a square clip at another size, and cameras to match."""
    clip, pixel_map = clip_of(recording)
    size = (side, side)
    frames = [
        cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
        for image in clip.read_view(0, 0, count)
    ]
    # pixel centres are integers: a pixel of the large image in those of the small one
    scale = clip.sizes[0][0] / side
    shift = 0.5 * (scale - 1)
    matrix = torch.tensor([[scale, 0, shift], [0, scale, shift], [0, 0, 1]], dtype=torch.float64)
    assert pixel_map.identity and clip.sizes[0][0] == clip.sizes[0][1]
    cameras: Camera = PixelMap(matrix[None]).cameras(recording.cameras, [size])
    return Images(Kept(np.stack(frames)), cameras.frames(slice(0, count)))


def _timed(
    recording: Recording, images: Images, frames: int, workers: int
) -> dict[str, StageReport]:
    span = slice(0, frames)
    found = capture(
        recording.actor,
        recording.cameras.frames(span),
        recording.detections.frames(span),
        recording.rate,
        images=images.frames(span),
        workers=workers,
    )
    return {stage.name: stage for stage in found.stages}


def _profile(recording: Recording, images: Images, config: Experiment) -> None:
    with cProfile.Profile() as profile:
        _timed(recording, images, config.frames, 1)
    profile.dump_stats(str(config.profile))


def _rows(runs: list[dict[str, StageReport]], frames: int) -> tuple[tuple[object, ...], ...]:
    """Each stage, and all of them together."""
    parts = {name: [[run[name]] for run in runs] for name in _STAGES}
    parts["together"] = [[run[name] for name in _STAGES] for run in runs]
    rows = []
    for name, captures in parts.items():
        wall, cpu = (
            [1e3 * sum(getattr(stage, clock) for stage in stages) / frames for stages in captures]
            for clock in ("wall", "cpu")
        )
        rows.append((name, float(np.median(wall)), min(wall), max(wall), float(np.median(cpu))))
    return tuple(rows)


if __name__ == "__main__":
    report.main(run, Experiment, "surface_speed")
