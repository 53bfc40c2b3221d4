"""A mesh to fit to: nearest points, normals, and samples spread over its area."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from perfcap.geometry.surface_topology import face_areas

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DENSE = 30_000  # samples in which nearest points are looked for


class TargetSurface:
    """Samples of a surface with their normals, dense and spread evenly.

    Args:
        vertices: (V, 3), metres.
        faces: (T, 3).
        rng: chooses the samples.
        dense: how many.
    """

    def __init__(
        self, vertices: Floats, faces: Integers, rng: np.random.Generator, dense: int = DENSE
    ) -> None:
        area = face_areas(vertices, faces)
        face = rng.choice(len(faces), dense, p=area / area.sum())
        u, v = rng.uniform(size=(2, dense, 1))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        a, b, c = (vertices[faces[face, corner]] for corner in range(3))
        self.points: Floats = a + u * (b - a) + v * (c - a)
        normal = np.cross(b - a, c - a)
        self.normals: Floats = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        self._tree = cKDTree(self.points)

    def nearest(self, points: Floats) -> tuple[Floats, Integers]:
        """Distance (N,) to the nearest sample, and which that is (N,)."""
        distance, at = self._tree.query(points)
        return distance, at


def spread(vertices: Floats, faces: Integers, count: int, rng: np.random.Generator) -> Integers:
    """Different vertices, chosen at random in proportion to their share of the area, sorted."""
    area = np.bincount(faces.ravel(), np.repeat(face_areas(vertices, faces), 3), len(vertices))
    count = min(count, int((area > 0).sum()))
    chosen: Integers = np.sort(rng.choice(len(vertices), count, False, p=area / area.sum()))
    return chosen


def vertex_normals(vertices: Floats, faces: Integers) -> Floats:
    """Area-weighted unit normals, (V, 3); zero where there is no area."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    total = np.zeros_like(vertices)
    np.add.at(total, faces, np.cross(b - a, c - a)[:, None])
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))
