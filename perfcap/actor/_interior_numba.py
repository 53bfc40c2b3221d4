"""Points inside a mesh: columns of a grid, cut where they cross its triangles."""

import math

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import kernel

Floats = NDArray[np.float64]
_DEEPEST = 64  # crossings of a column; more are ignored, which no person's mesh has


@kernel()
def crossings(
    vertices: Floats, faces: NDArray[np.int64], low: Floats, spacing: float, shape: tuple[int, int]
) -> tuple[Floats, NDArray[np.int8], NDArray[np.int64]]:
    """Where columns along z meet triangles.

    Args:
        vertices: (V, 3).
        faces: (T, 3), counter-clockwise seen from outside.
        low: x and y of the first column.
        spacing: between columns.
        shape: columns along x and y.

    Returns:
        z of each crossing (X, Y, 64), whether the way along +z leads in (1) or out (-1), likewise,
        and their number (X, Y).
    """
    z = np.empty((shape[0], shape[1], _DEEPEST))
    sense = np.empty((shape[0], shape[1], _DEEPEST), np.int8)
    count = np.zeros(shape, np.int64)
    for face in range(len(faces)):
        a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-14:
            continue
        first_x = max(0, math.ceil((min(a[0], b[0], c[0]) - low[0]) / spacing))
        first_y = max(0, math.ceil((min(a[1], b[1], c[1]) - low[1]) / spacing))
        last_x = min(shape[0] - 1, math.floor((max(a[0], b[0], c[0]) - low[0]) / spacing))
        last_y = min(shape[1] - 1, math.floor((max(a[1], b[1], c[1]) - low[1]) / spacing))
        for i in range(first_x, last_x + 1):
            for j in range(first_y, last_y + 1):
                x, y = low[0] + i * spacing, low[1] + j * spacing
                u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                if u < 0 or v < 0 or u + v > 1 or count[i, j] == _DEEPEST:
                    continue
                at = count[i, j]
                z[i, j, at] = u * a[2] + v * b[2] + (1 - u - v) * c[2]
                sense[i, j, at] = -1 if area > 0 else 1  # its normal has the sign of the area
                count[i, j] += 1
    return z, sense, count
