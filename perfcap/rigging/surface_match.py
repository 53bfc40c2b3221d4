"""A mesh to fit to, and the energy that draws a body model to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Points
from perfcap.geometry.surface_topology import face_areas
from perfcap.solve import Coupling, Energy, Linearization, Residual
from perfcap.solve.kernels import Kernel

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


@dataclass(frozen=True, eq=False)
class Matches:
    """Where points should be: place (N, 3), unit normal of the surface there (N, 3), trust (N,)."""

    place: Tensor
    normal: Tensor
    trust: Tensor


class SurfaceMatch(Energy[Motion]):
    """Distance of points of a body to places on a surface, mostly along its normal.

    The residual of a point is ``(slide + (1 - slide) n n') (x - y)``: points may slide along the
    surface at a price of ``slide``, which keeps smooth limbs from turning in place.

    Args:
        points: of the body, N; their shape is unknown too.
        matches: of each.
        slide: 1 is the plain distance, 0 the distance to the tangent plane.
        weight: of the energy.
        kernel: acts on the squared residual, metres.
    """

    coupling = Coupling.FRAME
    place: Tensor
    trust: Tensor
    metric: Tensor

    def __init__(
        self,
        points: Points,
        matches: Matches,
        slide: float = 0.3,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
    ) -> None:
        super().__init__(weight, kernel)
        self.points, self.sees = points, points.sees
        normal = matches.normal
        outer = normal[:, :, None] * normal[:, None]
        self.register_buffer("metric", slide * torch.eye(3).to(outer) + (1 - slide) * outer)
        self.register_buffer("place", matches.place)
        self.register_buffer("trust", matches.trust)

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, N, 3)."""
        return self._residual(self.points(motion))

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form."""
        points, frame, shared = self.points.linearize(motion)
        of_shared = None if shared is None else self.metric @ shared
        return Linearization(self._residual(points), self.metric @ frame, of_shared)

    def _residual(self, points: Tensor) -> Residual:
        error = (self.metric @ (points - self.place)[..., None]).squeeze(-1)
        return Residual(error, self.trust.expand(error.shape[:-1]))
