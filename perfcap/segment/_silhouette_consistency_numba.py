"""Coverage of many poses of one mesh in one view, and what it costs: compiled loops.

A pixel that is covered for the first time changes three sums, so that no picture is looked
through. Pixel centres on an edge are covered by both triangles, which changes nothing. Triangles
that are seen from inside are left out: of a closed surface they cover nothing else, and what is
open has triangles of both sides (``CoarseMesh.of``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

ANY, SEEN = 1, 2  # bits of a covered pixel: by the person, by a part that was seen before


@kernel()
def cover(
    x: NDArray[np.floating],
    y: NDArray[np.floating],
    usable: NDArray[np.bool_],
    faces: NDArray[np.int64],
    seen: NDArray[np.bool_],
    inside: NDArray[np.bool_],
    distance: NDArray[np.float32],
    picture: NDArray[np.uint8],
    sums: NDArray[np.float64],
) -> None:
    """Cover a picture with triangles, and add to its sums what that changes.

    Args:
        x: column of each vertex in the picture, (V,) px.
        y: row, (V,) px.
        usable: (V,), False where a vertex is behind the camera: its triangles are left out.
        faces: (T, 3), counter-clockwise seen from outside.
        seen: whether each triangle's part was seen before, (T,).
        inside: the silhouette, (h, w).
        distance: to the silhouette, (h, w), 0 inside.
        picture: bits of covered pixels, (h, w), written.
        sums: silhouette that is covered, distance of what was seen before, its area: (3,), written.
    """
    height, width = picture.shape
    for index in range(len(faces)):
        a, b, c = faces[index, 0], faces[index, 1], faces[index, 2]
        if not (usable[a] and usable[b] and usable[c]):
            continue
        # clockwise where rows go down: seen from outside, two corners change places
        ax, bx, cx = x[a], x[c], x[b]
        ay, by, cy = y[a], y[c], y[b]
        if not (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0:  # or not a number
            continue
        left, right = min(ax, bx, cx), max(ax, bx, cx)
        top, bottom = min(ay, by, cy), max(ay, by, cy)
        bits = ANY | SEEN if seen[index] else ANY
        first, last = _steps(left, right, width)
        lowest, highest = _steps(top, bottom, height)
        for row in range(lowest, highest + 1):
            for column in range(first, last + 1):
                old = picture[row, column]
                new = old | bits
                if new == old or not _within(ax, ay, bx, by, cx, cy, column, row):
                    continue
                picture[row, column] = new
                if inside[row, column] and not old & ANY:
                    sums[0] += 1.0
                if new & SEEN and not old & SEEN:
                    sums[1] += distance[row, column]
                    sums[2] += 1.0


@inner()
def _steps(low, high, side):  # type: ignore[no-untyped-def]
    """First and last whole number of a range, of those of a side; it may be infinite."""
    return int(min(max(np.ceil(low), 0.0), side)), int(max(min(np.floor(high), side - 1.0), -1.0))


@inner()
def _within(ax, ay, bx, by, cx, cy, x, y):  # type: ignore[no-untyped-def]
    """Whether (x, y) is in a triangle of positive area, or on its edges."""
    return (
        (bx - ax) * (y - ay) >= (by - ay) * (x - ax)
        and (cx - bx) * (y - by) >= (cy - by) * (x - bx)
        and (ax - cx) * (y - cy) >= (ay - cy) * (x - cx)
    )


@kernel()
def cover_each(
    x: NDArray[np.floating],
    y: NDArray[np.floating],
    usable: NDArray[np.bool_],
    faces: NDArray[np.int64],
    seen: NDArray[np.bool_],
    inside: NDArray[np.bool_],
    distance: NDArray[np.float32],
    picture: NDArray[np.uint8],
    sums: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Sums (N, 3) of N poses (N, V) on top of a picture that is covered already.

    Arguments are those of ``cover``, of which ``picture`` and ``sums`` stay as they are.
    """
    found = np.empty((len(x), 3))
    for number in range(len(x)):
        found[number] = sums
        own = picture.copy()
        where = x[number], y[number], usable[number]
        cover(*where, faces, seen, inside, distance, own, found[number])
    return found
