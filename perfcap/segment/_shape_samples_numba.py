"""Which part of whom each pixel shows, in many poses of several people: compiled loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import kernel
from perfcap.render._zbuffer_numba import fill


@kernel()
def show(
    grid: NDArray[np.int64],
    inverse_depth: NDArray[np.float64],
    usable: NDArray[np.bool_],
    faces: NDArray[np.int64],
    labels: NDArray[np.int16],
    parts: int,
    front: int,
    bits: int,
    shown: NDArray[np.int16],
) -> None:
    """Label of the nearest face at each pixel of each sample (Liu et al. 2013, Sec. 5.2.2).

    Where faces that are seen from outside are left out and another person is nearest then, that
    person's part is shown: it is inside the first one.

    Args:
        grid: vertices (N, V, 2), as of ``fill``.
        inverse_depth: (N, V) 1/m.
        usable: (N, V).
        faces: of everybody, (T, 3).
        labels: of each face, the person's number times ``parts`` plus the part, (T,).
        parts: P.
        front: sign of faces that the second projection leaves out; 0 for no second one.
        bits: fractional bits of the grid.
        shown: (N, h, w), written; -1 where nobody is.
    """
    depth = np.empty(shown.shape[1:], np.float64)
    triangle = np.empty(shown.shape[1:], np.int32)
    for number in range(len(shown)):
        mesh = grid[number], inverse_depth[number], usable[number], faces
        depth[:], triangle[:] = np.inf, -1
        fill(*mesh, 0, bits, depth, triangle)
        own = shown[number]
        for row in range(own.shape[0]):
            for column in range(own.shape[1]):
                index = triangle[row, column]
                own[row, column] = labels[index] if index >= 0 else -1
        if front == 0:
            continue
        depth[:], triangle[:] = np.inf, -1
        fill(*mesh, front, bits, depth, triangle)
        for row in range(own.shape[0]):
            for column in range(own.shape[1]):
                index, first = triangle[row, column], own[row, column]
                if index >= 0 and first >= 0 and labels[index] // parts != first // parts:
                    own[row, column] = labels[index]
