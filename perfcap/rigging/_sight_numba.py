"""Compiled part of ``sight``: walk a grid of triangles along segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_NEAR = 1e-6  # metres from the start within which nothing is in the way
_EDGE = 1e-9  # widens triangles, so that no ray slips through between two


@kernel()
def cells_of(corners: Floats, low: Floats, cell: float, shape: Integers) -> tuple:  # type: ignore[type-arg]
    """Triangles whose boxes touch each cell: start (cells + 1,), triangles (N,)."""
    boxes = np.empty((len(corners), 2, 3), np.int64)
    count = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for t in range(len(corners)):
        for axis in range(3):
            first = min(corners[t, 0, axis], corners[t, 1, axis], corners[t, 2, axis])
            last = max(corners[t, 0, axis], corners[t, 1, axis], corners[t, 2, axis])
            boxes[t, 0, axis] = min(max(int((first - low[axis]) / cell), 0), shape[axis] - 1)
            boxes[t, 1, axis] = min(max(int((last - low[axis]) / cell), 0), shape[axis] - 1)
        for x in range(boxes[t, 0, 0], boxes[t, 1, 0] + 1):
            for y in range(boxes[t, 0, 1], boxes[t, 1, 1] + 1):
                for z in range(boxes[t, 0, 2], boxes[t, 1, 2] + 1):
                    count[(x * shape[1] + y) * shape[2] + z + 1] += 1
    start = np.cumsum(count)
    place, triangles = start.copy(), np.empty(start[-1], np.int64)
    for t in range(len(corners)):
        for x in range(boxes[t, 0, 0], boxes[t, 1, 0] + 1):
            for y in range(boxes[t, 0, 1], boxes[t, 1, 1] + 1):
                for z in range(boxes[t, 0, 2], boxes[t, 1, 2] + 1):
                    index = (x * shape[1] + y) * shape[2] + z
                    triangles[place[index]] = t
                    place[index] += 1
    return start, triangles


@kernel()
def blocked(
    starts: Floats,
    ends: Floats,
    own: Integers,
    corners: Floats,
    faces: Integers,
    low: Floats,
    cell: float,
    shape: Integers,
    first: Integers,
    triangles: Integers,
) -> NDArray[np.bool_]:
    """Whether a triangle other than those of the place it starts at crosses each segment."""
    result = np.zeros(len(starts), np.bool_)
    at, step = np.empty(3, np.int64), np.empty(3, np.int64)
    until, per_cell = np.empty(3), np.empty(3)
    for n in range(len(starts)):
        for axis in range(3):
            along = ends[n, axis] - starts[n, axis]
            here = (starts[n, axis] - low[axis]) / cell
            at[axis] = min(max(int(np.floor(here)), 0), shape[axis] - 1)
            step[axis] = 1 if along > 0 else -1
            if along == 0.0:
                until[axis], per_cell[axis] = np.inf, np.inf
            else:
                per_cell[axis] = cell / abs(along)
                until[axis] = (at[axis] + (along > 0) - here) * cell / along
        while True:
            index = (at[0] * shape[1] + at[1]) * shape[2] + at[2]
            for k in range(first[index], first[index + 1]):
                t = triangles[k]
                mine = faces[t, 0] == own[n] or faces[t, 1] == own[n] or faces[t, 2] == own[n]
                if not mine and _crosses(starts, ends, n, corners, t):
                    result[n] = True
                    break
            axis = int(np.argmin(until))
            if result[n] or until[axis] > 1.0:
                break
            at[axis] += step[axis]
            until[axis] += per_cell[axis]
            if at[axis] < 0 or at[axis] >= shape[axis]:
                break
    return result


@inner()
def _crosses(starts: Floats, ends: Floats, n: int, corners: Floats, t: int) -> bool:
    """Whether a segment meets a triangle (Moeller and Trumbore 1997)."""
    origin, ray = starts[n], ends[n] - starts[n]
    first = corners[t, 1] - corners[t, 0]
    second = corners[t, 2] - corners[t, 0]
    cross = np.array(
        [
            ray[1] * second[2] - ray[2] * second[1],
            ray[2] * second[0] - ray[0] * second[2],
            ray[0] * second[1] - ray[1] * second[0],
        ]
    )
    volume = first[0] * cross[0] + first[1] * cross[1] + first[2] * cross[2]
    if abs(volume) < 1e-18:
        return False
    offset = origin - corners[t, 0]
    u = (offset[0] * cross[0] + offset[1] * cross[1] + offset[2] * cross[2]) / volume
    if u < -_EDGE or u > 1 + _EDGE:
        return False
    other = np.array(
        [
            offset[1] * first[2] - offset[2] * first[1],
            offset[2] * first[0] - offset[0] * first[2],
            offset[0] * first[1] - offset[1] * first[0],
        ]
    )
    v = (ray[0] * other[0] + ray[1] * other[1] + ray[2] * other[2]) / volume
    if v < -_EDGE or u + v > 1 + _EDGE:
        return False
    share = (second[0] * other[0] + second[1] * other[1] + second[2] * other[2]) / volume
    length = np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
    return bool(share * length > _NEAR and share < 1.0)
