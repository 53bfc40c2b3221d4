"""Memory and time of a whole capture from four large videos of a real man.

Four upright views, 1088 x 1920, there and back again until the clip is long enough; frames are
decoded as they are asked for. Memory above the inputs is sampled while all stages run: it should
not grow with the clip by more than the result. One view is a rendered clip of 1000 x 1000.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import report
import torch
from long_clip import Memory
from long_surface import Swinging, result_mib, there_and_back
from recordings import Recording, balancing, rendered
from report import Report, Table
from surface_recordings import clip_of, images_of

from perfcap.actor.actor import Actor
from perfcap.io.calibration import PixelMap
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture

_COLUMNS = (
    "views", "image", "frames", "wall, ms a frame", "CPU, ms a frame", "peak above inputs, MiB",
    "result, MiB",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    frames: tuple[int, ...] = (20, 200)
    """Lengths of clips of four views."""
    sequence: str = "dev_tight"
    """Of ``rendered``, for one view."""
    alone: int = 100
    """Frames of one view; 0 to leave it out."""
    size: int = 1000
    """Side of its square image, px."""
    workers: int = 2
    """Threads of the stages."""


def run(config: Experiment) -> Report:
    """Capture four views for longer and longer, and one view."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    real = balancing(config.data)
    clip, pixel_map = clip_of(real)
    whole = Images(clip, pixel_map.cameras(real.cameras, clip.sizes))
    actor = capture(real.actor, real.cameras, real.detections, real.rate, solve_bones=True).actor
    _row(real, actor, whole, 10, config.workers)  # compiles kernels
    rows = [_row(real, actor, whole, frames, config.workers) for frames in config.frames]
    if config.alone:
        one = rendered(config.data, config.sequence)
        rows.append(_row(one, one.actor, _enlarged(one, config.size), config.alone, config.workers))
    return Report((Table(f"{config.workers} workers", _COLUMNS, tuple(rows)),))


def _enlarged(recording: Recording, side: int) -> Images:
    whole = images_of(recording)
    scale = whole.cameras.size[0][0] / side
    shift = 0.5 * (scale - 1)  # pixel centres are integers
    matrix = torch.tensor([[scale, 0, shift], [0, scale, shift], [0, 0, 1]], dtype=torch.float64)
    cameras = PixelMap(matrix[None]).cameras(whole.cameras, [(side, side)])
    return Images(whole.reader, cameras)


def _row(
    recording: Recording, actor: Actor, images: Images, frames: int, workers: int
) -> tuple[object, ...]:
    order = there_and_back(len(images.reader), frames)
    index = torch.tensor(order)
    cameras, size = images.cameras, images.cameras.size[0]
    swinging = Images(
        Swinging(images.reader, order, cameras.size), cameras.frames(index), images.segmenter
    )
    clocks = time.perf_counter(), time.process_time()
    with Memory() as memory:
        found = capture(
            actor, recording.cameras.frames(index), recording.detections.frames(index),
            recording.rate, images=swinging, workers=workers,
        )  # fmt: skip
    spent = time.perf_counter() - clocks[0], time.process_time() - clocks[1]
    each = [1e3 * seconds / frames for seconds in spent]
    shape = f"{size[1]} x {size[0]}"
    return cameras.views, shape, frames, *each, memory.peak / 2**20, result_mib(found)


if __name__ == "__main__":
    report.main(run, Experiment, "image_memory")
