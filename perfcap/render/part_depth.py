"""How far a part of the surface goes inward from its contour until another part takes over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.integer]

_START = 1.5  # px inward, where a point's own part is seen for sure
_CHUNK = 64  # points looked inward from at once


def part_depth(
    points: Floats,
    normals: Floats,
    parts: Integers,
    reach: float,
    corner: tuple[int, int] = (0, 0),
) -> Floats:
    """Width of the part that a contour point is on, where its far side lies before another part.

    An arm that hangs in front of the torso, or beside it and touching, has one side only on the
    silhouette. Where its other side would have to be is known from the model alone.

    Args:
        points: of the model's contour, (P, 2) px.
        normals: outward, unit, (P, 2).
        parts: which part each pixel sees, (H, W), negative where it sees none.
        reach: px to look inward.
        corner: row and column of the image at which ``parts`` begin.

    Returns:
        (P,) px; infinite where background ends the part, or nothing does within reach.
    """
    steps = np.arange(_START, max(reach, _START) + 1.0)
    found = np.empty(len(points))
    for first in range(0, len(points), _CHUNK):  # what a chunk needs stays in the cache
        chunk = slice(first, first + _CHUNK)
        at = points[chunk, None] - steps[:, None] * normals[chunk, None]  # P S 2
        found[chunk] = _depth(at, parts, steps, corner)
    return found


def _depth(at: Floats, parts: Integers, steps: Floats, corner: tuple[int, int]) -> Floats:
    """The step (P,) at which another part begins along places (P, S, 2) px."""
    column, row = np.rint(at).astype(np.int64).transpose(2, 0, 1)
    row, column = row - corner[0], column - corner[1]
    height, width = parts.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    seen = np.where(inside, parts[row.clip(0, height - 1), column.clip(0, width - 1)], -1)
    other = seen != seen[:, :1]
    first = other.argmax(1)
    ends = other.any(1) & (seen[:, 0] >= 0) & (seen[np.arange(len(seen)), first] >= 0)
    return np.where(ends, steps[first], np.inf)
