"""How far a part of the surface goes inward from its contour until another part takes over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_shape
from perfcap.errors import InputError
from perfcap.render import _part_depth_numba
from perfcap.setting_checks import require_number

Floats = NDArray[np.float64]
Integers = NDArray[np.integer]

_START = 1.5  # px inward, where a point's own part is seen for sure


def part_depth(
    points: Floats,
    normals: Floats,
    parts: Integers,
    reach: float,
    corner: tuple[int, int] = (0, 0),
    of_triangle: Integers | None = None,
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
        of_triangle: which part each triangle belongs to, (T,), where ``parts`` are triangles; only
            those of pixels that are looked at are looked up.

    Returns:
        (P,) px; infinite where background ends the part, or nothing does within reach.

    Raises:
        InputError: normals of other points, parts that are no image, or an infinite reach.
    """
    require_shape(points, "points", (None, 2), "(P, 2) px")
    require_shape(normals, "normals", points.shape, "(P, 2), of each point")
    require_shape(parts, "parts", (None, None), "(H, W), of each pixel")
    require_number(reach, "reach")
    steps = np.arange(_START, max(reach, _START) + 1.0)
    found = np.empty(len(points))
    seen = np.ascontiguousarray(parts, np.int32 if parts.dtype == np.int32 else np.int64)
    if of_triangle is not None and seen.max(initial=-1) >= len(of_triangle):
        raise InputError(
            f"parts name triangle {seen.max()} but of_triangle has {len(of_triangle)}; give the "
            "part of every one"
        )
    table = np.ascontiguousarray(() if of_triangle is None else of_triangle, np.int64)
    _part_depth_numba.look_inward(points, normals, seen, table, steps, corner, found)
    return found
