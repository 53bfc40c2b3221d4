"""The Laplacian of a triangle mesh that may be a bad one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_MOLLIFY = 1e-3  # of the mean edge: how far triangles stay from being degenerate
_LEAST = 1e-2  # least conductance of an edge; cotangents of obtuse pairs are negative


def laplacian(places: Floats, faces: Integers) -> tuple[csr_array, Floats]:
    """Conductances between places, and the area of each: ``(L, M)``.

    Cotangent weights on lengths that were made longer until no triangle is degenerate (Sharp and
    Crane 2020), summed over the triangles of an edge however many they are. Negative ones are
    raised to a small positive number: L has no positive entries off the diagonal then, so heat
    stays between its sources and shares keep their sum.

    Returns:
        L (U, U), positive semidefinite with zero row sums, and M (U,), square metres.
    """
    corners = places[faces]
    # side k is opposite to corner k
    length = np.linalg.norm(np.roll(corners, -1, 1) - np.roll(corners, 1, 1), axis=-1)
    floor = _MOLLIFY * float(length.mean()) if len(length) else 0.0
    excess = 2 * length.max(1, initial=0.0) - length.sum(1)  # above 0: the sides do not close
    length = length + np.maximum(floor + excess, 0.0).max(initial=0.0)
    half = length.sum(1) / 2
    area = np.sqrt(half * (half[:, None] - length).prod(1))
    squared = length**2
    cotangent = (squared.sum(1, keepdims=True) - 2 * squared) / (4 * area[:, None])
    return _assemble(faces, 0.5 * cotangent, len(places)), _areas(faces, area, len(places))


def _assemble(faces: Integers, conductance: Floats, places: int) -> csr_array:
    """L from the conductance of the side opposite to each corner, (T, 3)."""
    start, end = np.roll(faces, -1, 1).ravel(), np.roll(faces, 1, 1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    upper = csr_array((conductance.ravel(), (low, high)), shape=(places, places))
    upper.sum_duplicates()
    upper.data = np.maximum(upper.data, _LEAST)
    both = upper + upper.T
    return csr_array(diags_array(np.asarray(both.sum(1)).ravel()) - both)


def _areas(faces: Integers, area: Floats, places: int) -> Floats:
    share = np.bincount(faces.ravel(), np.repeat(area / 3, 3), places)
    return np.maximum(share, 1e-9 * max(float(share.max(initial=0.0)), 1e-9))
