"""Triangles that face the camera, and edges where it sees them turn away, as compiled loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

Flags = NDArray[np.bool_]


@kernel()
def facing(
    pixels: NDArray[np.float64],
    depth: NDArray[np.float64],
    faces: NDArray[np.int64],
    limits: tuple[float, float],
    front: Flags,
    drawn: Flags,
) -> None:
    """Which triangles are seen from outside, and which of them can be drawn at all.

    Args:
        pixels: of the vertices, (V, 2) px, y pointing down.
        depth: (V,) m.
        faces: (T, 3).
        limits: px from the origin up to which, and depth from which on, a vertex is usable.
        front: (T,), written.
        drawn: (T,), written.
    """
    for index in range(len(faces)):
        a, b, c = np.uint64(faces[index, 0]), np.uint64(faces[index, 1]), np.uint64(faces[index, 2])
        ax, ay = pixels[a, 0], pixels[a, 1]
        bx, by = pixels[b, 0] - ax, pixels[b, 1] - ay
        cx, cy = pixels[c, 0] - ax, pixels[c, 1] - ay
        front[index] = bx * cy - by * cx < 0
        drawn[index] = (
            _usable(pixels, depth, a, limits)
            and _usable(pixels, depth, b, limits)
            and _usable(pixels, depth, c, limits)
        )


@inner()
def _usable(pixels, depth, i, limits):  # type: ignore[no-untyped-def]
    """Comparisons with what is no number are false."""
    x, y, z = abs(pixels[i, 0]), abs(pixels[i, 1]), depth[i]
    return x <= limits[0] and y <= limits[0] and limits[1] <= z < np.inf


@kernel()
def folded(
    front: Flags, drawn: Flags, sides: NDArray[np.int64], turned: Flags, kept: Flags
) -> None:
    """Edges between a triangle that faces the camera and one that does not, or beside nothing.

    Args:
        front: whether a triangle is seen from outside, (T,).
        drawn: whether it can be drawn, (T,).
        sides: the triangles beside each edge, (E, 2), the second one -1 on an open boundary.
        turned: where the two disagree about which side is outside, (E,).
        kept: (E,), written.
    """
    for edge in range(len(sides)):
        one, other = sides[edge, 0], sides[edge, 1]
        if other < 0:
            kept[edge] = drawn[one]
        else:
            differ = (front[one] != front[other]) != turned[edge]
            kept[edge] = drawn[one] and drawn[other] and differ
