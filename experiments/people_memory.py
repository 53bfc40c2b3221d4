"""Memory and time of a capture of two people from eight views of 1080 px.

The six views of a rendered take, enlarged, and the first two of them again; there and back again
until the clip is long enough. Frames are decoded and enlarged as they are asked for. Memory above
the inputs is sampled while all stages run: it should not grow by more than the result does.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from long_clip import Memory
from long_surface import Swinging, result_mib, there_and_back
from numpy.typing import NDArray
from people_labels import Take
from report import Report, Table

from perfcap.geometry.camera import Camera
from perfcap.io.calibration import PixelMap
from perfcap.io.clip import FrameReader
from perfcap.pipeline.images import Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.people import Scene


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequence: str = "dev_duo"
    """Of ``rendered_multi``."""
    frames: tuple[int, ...] = (4, 12)
    """Lengths of clips."""
    views: int = 8
    """Those of the sequence, the first ones again where there are too few."""
    height: int = 1080
    """Of the enlarged images, px."""


@dataclass(frozen=True)
class _Chosen:
    """Some views of a reader, in any order."""

    reader: FrameReader
    views: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.reader)

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        """A reader's only method."""
        return self.reader.read_view(self.views[view], start, stop)


def run(config: Experiment) -> Report:
    """Captures of longer and longer clips."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    take = Take.read(config.data, config.sequence)
    count = take.images.cameras.views
    views = tuple(view % count for view in range(config.views))
    rows = [_row(take, views, frames, config.height) for frames in config.frames]
    columns = (
        "views", "height", "frames", "CPU, s a frame", "wall, s a frame", "peak above inputs, MiB",
        "result, MiB",
    )  # fmt: skip
    return Report((Table(f"{config.sequence}, two people", columns, tuple(rows)),))


def _row(take: Take, views: tuple[int, ...], frames: int, height: int) -> tuple[object, ...]:
    order = there_and_back(len(take.images.reader), frames)
    index = torch.tensor(order)
    cameras = _enlarged(take.images.cameras.select(list(views)), height)
    reader = Swinging(_Chosen(take.images.reader, views), order, cameras.size)
    cast = tuple(
        replace(each, detections=each.detections.select(list(views)).frames(index))
        for each in take.cast
    )
    first = take.people[0]
    images = Images(reader, cameras.frames(index))
    scene = Scene(first.cameras.select(list(views)).frames(index), cast, first.rate, images)
    clocks = time.perf_counter(), time.process_time()
    with Memory() as memory:
        found = capture(scene, workers=1)
    wall, cpu = time.perf_counter() - clocks[0], time.process_time() - clocks[1]
    result = sum(result_mib(each) for each in found)
    return len(views), height, frames, cpu / frames, wall / frames, memory.peak / 2**20, result


def _enlarged(cameras: Camera, height: int) -> Camera:
    """The same cameras in pixels of larger images."""
    sizes, matrices = [], []
    for rows, columns in cameras.size:
        scale = rows / height  # of pixels as calibrated to those enlarged
        shift = 0.5 * (scale - 1)  # pixel centres are integers
        matrices.append([[scale, 0, shift], [0, scale, shift], [0, 0, 1]])
        sizes.append((height, round(columns / scale)))
    return PixelMap(torch.tensor(matrices, dtype=torch.float64)).cameras(cameras, sizes)


if __name__ == "__main__":
    report.main(run, Experiment, "people_memory")
