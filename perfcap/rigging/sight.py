"""Whether a mesh stands between two points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.rigging import _sight_numba

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

_MOST_CELLS = 4_000_000
_EDGES_A_CELL = 2.0  # cells are about this many edges wide


class Sight:
    """Line of sight through the triangles of a mesh, found through a uniform grid.

    Args:
        places: (U, 3), metres.
        faces: (T, 3).
    """

    def __init__(self, places: Floats, faces: Integers) -> None:
        self._faces = np.ascontiguousarray(faces)
        self._corners = np.ascontiguousarray(places[faces])
        low, high = places.min(0) - 1e-6, places.max(0) + 1e-6
        edge = np.linalg.norm(self._corners - np.roll(self._corners, 1, 1), axis=-1)
        cell = _EDGES_A_CELL * float(np.median(edge)) if len(edge) else 1.0
        cell = max(cell, float(np.prod(high - low) / _MOST_CELLS) ** (1 / 3), 1e-9)
        shape = np.ceil((high - low) / cell).astype(np.int64).clip(min=1)
        while np.prod(shape.astype(float)) > _MOST_CELLS:
            cell *= 1.3
            shape = np.ceil((high - low) / cell).astype(np.int64).clip(min=1)
        self._grid = (low, cell, shape)
        self._cells = _sight_numba.cells_of(self._corners, *self._grid)

    def blocked(self, starts: Floats, ends: Floats, own: Integers) -> Flags:
        """Whether a triangle lies between starts and ends, (N, 3) each; (N,).

        Args:
            starts: points, metres.
            ends: points, metres.
            own: the place each start is at, (N,); triangles at it never block. -1 for none.
        """
        starts, ends = (np.ascontiguousarray(p, dtype=np.float64) for p in (starts, ends))
        hidden: Flags = _sight_numba.blocked(
            starts, ends, own, self._corners, self._faces, *self._grid, *self._cells
        )
        return hidden
