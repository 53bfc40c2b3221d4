"""The images of a clip, as the stages that look at them want them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera

Frames = NDArray[np.uint8]


class FrameReader(Protocol):
    """Frames of C synchronous views, read in blocks; ``perfcap.io.clip.Clip`` is one."""

    def __len__(self) -> int: ...

    def read_view(self, view: int, start: int, stop: int) -> Frames:
        """RGB frames ``start`` to ``stop`` of a view, (stop - start, H, W, 3) uint8."""


@dataclass(frozen=True)
class Images:
    """Frames, and cameras in their pixels.

    Attributes:
        reader: the frames, in the order of those that are captured.
        cameras: C views in pixels of the images, (C,) or (F, C), with their sizes.
    """

    reader: FrameReader
    cameras: Camera

    def __post_init__(self) -> None:
        if len(self.cameras.size) != self.cameras.views:
            raise InputError(
                f"images have cameras of {self.cameras.views} views with "
                f"{len(self.cameras.size)} image sizes; give the (height, width) of every view"
            )
