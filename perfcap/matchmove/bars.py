"""Bars of one colour beside a picture that was fitted into a wider or higher video."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_EVEN = 24  # of 255: by which a bar differs, in all its pixels and images, as compression leaves it
_EDGE = 0.02  # of the longer side: corners that are nearer see the bar's edge, which stands still
_MOST = 0.8  # of the image; more is no picture with bars


def find_bars(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.bool_]:
    """Where bars are, and the edge of the picture beside them, (H, W); False where none are.

    Args:
        images: (H, W, 3) each, some of a video.
    """
    size = images[0].shape[:2]
    found = np.zeros(size, np.bool_)
    low = np.minimum.reduce([image.min(-1) for image in images])
    high = np.maximum.reduce([image.max(-1) for image in images])
    edge = round(_EDGE * max(size))
    for axis in (0, 1):
        even = high.max(1 - axis).astype(int) - low.min(1 - axis) < _EVEN
        if even.all():
            return np.zeros(size, np.bool_)
        first, last = int(np.argmin(even)), len(even) - int(np.argmin(even[::-1]))
        across = np.ones(len(even), np.bool_)
        across[first + edge * (first > 0) : last - edge * (last < len(even))] = False
        found |= across[:, None] if axis == 0 else across[None]
    return found if found.mean() < _MOST else np.zeros(size, np.bool_)
