"""Memory of a whole capture with images, on clips up to a thousand frames long.

A rendered sequence there and back again, with its detections, until it is long enough; frames are
decoded from its video as they are asked for. Memory above the inputs is sampled from a thread while
the capture and, in a second column, the writing of its files run. It should not grow with the clip
by more than the result itself: motion, deformation of the graph, compressed masks.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import report
import torch
from long_clip import Memory
from recordings import Recording, rendered
from report import Report, Table
from surface_recordings import images_of

from perfcap.geometry.camera import Camera
from perfcap.io.calibration import PixelMap
from perfcap.io.clip import FrameReader
from perfcap.pipeline.images import Frames, Images
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.refine_surface import DeformedSurface

_COLUMNS = (
    "frames", "wall, ms a frame", "result, MiB", "peak above inputs, MiB", "above the result, MiB",
    "while saving, MiB",
)  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequence: str = "dev_tight"
    """Of ``rendered``."""
    frames: tuple[int, ...] = (250, 500, 1000)
    """Lengths of clips."""
    size: int = 320
    """Side of the square image, px; of 640."""
    workers: int = 2
    """Threads of the stages."""


@dataclass(frozen=True)
class Swinging:
    """Frames of a clip in another order, and of other sizes (H, W)."""

    reader: FrameReader
    order: list[int]
    sizes: Sequence[tuple[int, int]]

    def __len__(self) -> int:
        return len(self.order)

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        """A reader's only method."""
        order, (height, width) = self.order[start:stop], self.sizes[view]
        first = min(order)
        whole = self.reader.read_view(view, first, max(order) + 1)  # once, also where it goes back
        if whole.shape[1:3] == (height, width) and order == list(range(first, max(order) + 1)):
            return whole  # as a capture reads a clip: without copies
        frames = [whole[f - first] for f in order]
        smaller = height < frames[0].shape[0]
        kind = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        return np.stack([cv2.resize(f, (width, height), interpolation=kind) for f in frames])


def there_and_back(count: int, frames: int) -> list[int]:
    """So many of ``count`` frames, each next to its neighbours."""
    there = [*range(count), *range(count - 2, 0, -1)]
    return (there * -(-frames // len(there)))[:frames]


def run(config: Experiment) -> Report:
    """Capture the same clip for longer and longer."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    recording = rendered(config.data, config.sequence)
    _row(recording, 30, config)  # compiles kernels
    rows = tuple(_row(recording, frames, config) for frames in config.frames)
    title = f"{config.sequence}, {config.size}x{config.size}, {config.workers} workers"
    return Report((Table(title, _COLUMNS, rows),))


def _row(recording: Recording, frames: int, config: Experiment) -> tuple[object, ...]:
    order = there_and_back(recording.detections.frame_count, frames)
    index = torch.tensor(order)
    images, detections = _shrunk(recording, order, config.size), recording.detections.frames(index)
    cameras = recording.cameras.frames(index)
    started = time.perf_counter()
    with Memory() as memory:
        found = capture(
            recording.actor, cameras, detections, recording.rate, images=images,
            workers=config.workers,
        )  # fmt: skip
    wall = 1e3 * (time.perf_counter() - started) / frames
    with Memory() as saving, tempfile.TemporaryDirectory() as folder:
        found.save(folder)
    result = result_mib(found)
    peaks = [m.peak / 2**20 for m in (memory, saving)]
    return frames, wall, result, peaks[0], peaks[0] - result, peaks[1]


def _shrunk(recording: Recording, order: list[int], side: int) -> Images:
    whole = images_of(recording)
    scale = whole.cameras.size[0][0] / side
    shift = 0.5 * (scale - 1)  # pixel centres are integers
    matrix = torch.tensor([[scale, 0, shift], [0, scale, shift], [0, 0, 1]], dtype=torch.float64)
    small: Camera = PixelMap(matrix[None]).cameras(whole.cameras, [(side, side)])
    return Images(Swinging(whole.reader, order, small.size), small.frames(torch.tensor(order)))


def result_mib(found: Performance) -> float:
    """What a capture keeps of a clip, MiB."""
    refinement, motion = found.refinement, found.motion
    assert refinement is not None and refinement.surface is not None
    tensors = [motion.translation, motion.rotation, motion.angles]
    assert isinstance(refinement.surface.surface, DeformedSurface)
    for layer in refinement.surface.surface.layers:
        tensors += [layer.rotation, layer.translation]
    masks = refinement.evidence.silhouettes.size_bytes
    trust = sum(view.nbytes for row in refinement.evidence.confidence for view in row)
    return (sum(tensor.nbytes for tensor in tensors) + masks + trust) / 2**20


if __name__ == "__main__":
    report.main(run, Experiment, "long_surface")
