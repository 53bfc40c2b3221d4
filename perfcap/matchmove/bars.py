"""Bars of one colour beside a picture that was fitted into a wider or higher video."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_EVEN = 24  # of 255: by which a bar differs, in all its pixels and images, as compression leaves it
_EDGE = 0.02  # of the longer side: corners that are nearer see the bar's edge, which stands still
_ALIKE = 0.01  # of the longer side, by which two bars differ in width
_MOST = 0.8  # of the image; more is no picture with bars


def find_bars(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.bool_]:
    """Where bars are, and the edge of the picture beside them, (H, W); False where none are.

    Args:
        images: (H, W, 3) each, some of a video.
    """
    size = images[0].shape[:2]
    found = np.zeros(size, np.bool_)
    edge = round(_EDGE * max(size))
    spans = _spans(images)
    if spans is None:
        return found
    for axis, (first, last) in enumerate(spans):
        across = np.ones(size[axis], np.bool_)
        across[first + edge * (first > 0) : last - edge * (last < size[axis])] = False
        found |= across[:, None] if axis == 0 else across[None]
    return found if found.mean() < _MOST else np.zeros(size, np.bool_)


def picture_size(images: Sequence[NDArray[np.uint8]]) -> tuple[int, int]:
    """Height and width of a picture in the middle between two bars; without such, of the images.

    Bars are on two sides alone, and as wide: other even borders are those of a plain background.

    Args:
        images: (H, W, 3) each, some of a video.
    """
    height, width = images[0].shape[:2]
    size, spans = (height, width), _spans(images) or ((0, height), (0, width))
    narrower = [axis for axis in (0, 1) if spans[axis] != (0, size[axis])]
    if len(narrower) != 1:
        return size
    first, last = spans[narrower[0]]
    if abs(first - (size[narrower[0]] - last)) > _ALIKE * max(size):
        return size
    return (last - first, width) if narrower == [0] else (height, last - first)


def _spans(images: Sequence[NDArray[np.uint8]]) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """First row behind bars and first of those after it, and columns; None of one colour."""
    low = np.minimum.reduce([image.min(-1) for image in images])
    high = np.maximum.reduce([image.max(-1) for image in images])
    found = []
    for axis in (0, 1):
        even = high.max(1 - axis).astype(int) - low.min(1 - axis) < _EVEN
        if even.all():
            return None
        found.append((int(np.argmin(even)), len(even) - int(np.argmin(even[::-1]))))
    return found[0], found[1]
