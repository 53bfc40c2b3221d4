"""What the images say about the surface: masks, their contours, and how far to trust them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.segment import Contour, extract_contour

Mask = NDArray[np.bool_]

_FULL = 255  # a confidence of 1, as it is kept


@dataclass(frozen=True)
class Evidence:
    """Silhouettes of a clip, held compressed: a few kilobytes a frame and view.

    Attributes:
        masks_png: encoded masks, ``[frame][view]``; see ``mask``.
        confidence: of the points of each mask's contour, uint8, ``[frame][view]``.
        pixel_unit: one percent of the person's height in each view, (C,), pixels of the masks.
    """

    masks_png: tuple[tuple[bytes, ...], ...]
    confidence: tuple[tuple[NDArray[np.uint8], ...], ...]
    pixel_unit: Tensor

    @property
    def frames(self) -> int:
        """F."""
        return len(self.masks_png)

    def masks(self, frame: int) -> list[Mask]:
        """The person in every view, (H, W) each."""
        return [_decode(png) for png in self.masks_png[frame]]

    def contours(self, frame: int) -> list[Contour]:
        """The masks' contours in every view, with their confidence."""
        lines = map(extract_contour, self.masks(frame))
        return [
            Contour(line.points, line.normals, trust / _FULL)
            for line, trust in zip(lines, self.confidence[frame], strict=True)
        ]


def encode_mask(mask: Mask) -> bytes:
    """A mask (H, W) as a PNG, 0 background, 1 person."""
    done, data = cv2.imencode(".png", mask.astype(np.uint8))
    assert done
    return data.tobytes()


def encode_confidence(confidence: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Confidence in [0, 1] in a byte each."""
    return np.rint(confidence * _FULL).astype(np.uint8)


def _decode(png: bytes) -> Mask:
    mask: Mask = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE) > 0
    return mask
