"""How far points are from somebody's skin, and which of them are in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.floating]
Mesh = tuple[Floats, Floats]
"""Vertices (V, 3) m and their outward unit normals (V, 3)."""

_DEEP = 0.12  # m: what is deeper is no contact but another person's middle
_FACING = 0.6  # share of a way that must lead against the normal of where it ends


def signed_gap(points: Floats, skin: Mesh) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Distance of points from the vertices of a skin, negative inside, and the nearest vertex.

    Args:
        points: (N, 3), metres.
        skin: of somebody else.

    Returns:
        Metres (N,), and indices (N,).
    """
    distance, index = cKDTree(skin[0]).query(points)
    along = np.einsum("nk,nk->n", points - skin[0][index], skin[1][index])
    inside = (along < -_FACING * distance) & (distance < _DEEP)
    return np.where(inside, -distance, distance), index
