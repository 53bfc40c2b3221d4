"""Distances between surfaces, and of their vertices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from perfcap.array_checks import require_indices, require_shape
from perfcap.errors import InputError
from perfcap.setting_checks import require_count

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_CANDIDATES = 4  # samples whose triangles are looked at for the nearest point


@dataclass(frozen=True)
class SurfaceError:
    """Errors of one frame, millimetres.

    Attributes:
        vertex: mean distance of corresponding vertices.
        surface: mean distance to the other surface, both ways.
    """

    vertex: float
    surface: float


def surface_error(
    vertices: Floats,
    truth: Floats,
    faces: Integers,
    rng: np.random.Generator,
    part: NDArray[np.bool_] | None = None,
    samples: int = 25_000,
    queries: int = 6_000,
    translated: bool = True,
) -> SurfaceError:
    """Compare a surface with the truth, vertex by vertex and as surfaces.

    The depth offset that one camera cannot see is taken out by aligning the means of all vertices
    (Xu et al. 2018, Fig. 10). Distances to a surface are to the nearest of the triangles that the
    nearest few of its random samples lie on: exact but for rare misses.

    Args:
        vertices: (V, 3) m.
        truth: (V, 3) m, the same vertices.
        faces: (T, 3).
        rng: draws samples and queries.
        part: vertices to average over, (V,); all when not given. The alignment is of all.
        samples: points drawn on each surface, by area.
        queries: vertices whose distance is measured, at most.
        translated: whether the means of all vertices are aligned first.

    Raises:
        InputError: the vertices are not those of one template or no numbers, ``part`` is no mask of
            them, the faces are not of them or span no area, or nothing is drawn.
    """
    require_count(samples, "samples")
    require_count(queries, "queries")
    _require_part(part, len(truth))
    if vertices.shape != truth.shape or vertices.shape[-1:] != (3,) or vertices.ndim != 2:
        raise InputError(
            f"surface has vertices {vertices.shape} and the truth {truth.shape}; give vertices of "
            "one template, (V, 3), or use surface_distance"
        )
    require_indices(faces, "faces", len(truth), "vertices")
    _require_finite(vertices, "vertices")
    _require_finite(truth, "vertices of the truth")
    moved = vertices - vertices.mean(0) + truth.mean(0) if translated else vertices
    chosen = np.flatnonzero(part) if part is not None else np.arange(len(truth))
    vertex = np.linalg.norm(moved - truth, axis=1)[chosen].mean()
    asked = rng.permutation(chosen)[:queries]
    there = _distance(moved[asked], truth, faces, rng, samples)
    back = _distance(truth[asked], moved, faces, rng, samples)
    return SurfaceError(1e3 * float(vertex), 1e3 * float(there.mean() + back.mean()) / 2)


def surface_distance(
    vertices: Floats,
    faces: Integers,
    truth: Floats,
    truth_faces: Integers,
    rng: np.random.Generator,
    samples: int = 25_000,
    queries: int = 4_000,
    translated: bool = False,
) -> float:
    """Mean distance of two surfaces of any topology, both ways, millimetres.

    Args:
        vertices: (V, 3) m.
        faces: (T, 3).
        truth: (V', 3) m.
        truth_faces: (T', 3).
        rng: draws samples and queries.
        samples: points drawn on each surface, by area.
        queries: vertices of each whose distance is measured, at most; those of faces.
        translated: whether the centroids of both areas are aligned first.

    Raises:
        InputError: nothing is drawn, faces index no vertex or span no area, or their vertices are
            no numbers.
    """
    require_count(samples, "samples")
    require_count(queries, "queries")
    asked, answered = (
        used[rng.permutation(len(used))[:queries]]
        for used in (_used(vertices, faces, "faces"), _used(truth, truth_faces, "truth_faces"))
    )
    if translated:
        vertices = vertices - _centroid(vertices, faces) + _centroid(truth, truth_faces)
    there = _distance(vertices[asked], truth, truth_faces, rng, samples)
    back = _distance(truth[answered], vertices, faces, rng, samples)
    return 1e3 * float(there.mean() + back.mean()) / 2


def _centroid(vertices: Floats, faces: Integers) -> Floats:
    """Of the area of a surface, (3,), m."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    middle: Floats = (area[:, None] * corners.mean(1)).sum(0) / max(area.sum(), 1e-300)
    return middle


def vertex_error(
    vertices: Tensor, truth: Tensor, part: Tensor | None = None, translated: bool = True
) -> Tensor:
    """Mean distance of corresponding vertices in each frame, (*b, F), mm.

    Args:
        vertices: (*b, F, V, 3), metres; a frame with a NaN has no error, NaN.
        truth: (*b, F, V, 3), metres.
        part: vertices to average over, (V,) bool; all when not given. The alignment is of all.
        translated: whether the means of all vertices are aligned first.

    Raises:
        InputError: the vertices are not those of one template, or ``part`` is no mask of them.
    """
    if vertices.shape != truth.shape or vertices.shape[-1:] != (3,) or vertices.dim() < 3:
        raise InputError(
            f"vertices have shape {tuple(vertices.shape)} and the truth {tuple(truth.shape)}; give "
            "vertices of one template, (*b, F, V, 3)"
        )
    _require_part(part, vertices.shape[-2])
    offset = vertices - truth
    if translated:
        offset = offset - offset.mean(-2, keepdim=True)
    apart: Tensor = torch.linalg.vector_norm(offset, dim=-1)
    return 1e3 * (apart if part is None else apart[..., part]).mean(-1)


def _require_part(part: Any, count: int) -> None:
    """Refuse what is no mask of vertices: numbers would name others than were meant."""
    if part is None:
        return
    if tuple(part.shape) != (count,) or part.dtype not in (torch.bool, np.bool_):
        raise InputError(
            f"part has shape {tuple(part.shape)} and {part.dtype}, expected bool ({count},), true "
            "for each vertex that counts; make one of indices, as mask[indices] = True"
        )


def _used(vertices: Floats, faces: Integers, name: str) -> Integers:
    """Vertices of faces, in order: others, as of a scan, are no part of its surface."""
    require_shape(faces, name, (None, 3), "(T, 3)")
    require_indices(faces, name, len(vertices), "vertices")
    used: Integers = np.unique(faces)
    _require_finite(vertices[used], f"vertices of {name}")
    return used


def _require_finite(vertices: Floats, name: str) -> None:
    if not np.isfinite(vertices).all():
        raise InputError(f"{name} are not all finite; expected metres, leave such frames out")


def _distance(
    points: Floats, vertices: Floats, faces: Integers, rng: np.random.Generator, samples: int
) -> Floats:
    """Distance of points (N, 3) to a surface, (N,)."""
    corners = vertices[faces]  # T 3 3
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.cumsum(np.linalg.norm(normals, axis=1))
    if not len(area) or not area[-1] > 0:
        raise InputError(f"surface has {len(faces)} faces without area; expected triangles")
    drawn = np.searchsorted(area / area[-1], rng.random(samples)).clip(max=len(faces) - 1)
    u, v = rng.random((2, samples, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = corners[drawn].transpose(1, 0, 2)
    near = cKDTree(a + u * (b - a) + v * (c - a)).query(points, _CANDIDATES)[1]
    distance: Floats = point_triangle_distance(points[:, None], corners[drawn[near]]).min(1)
    return distance


def point_triangle_distance(points: Floats, corners: Floats) -> Floats:
    """Distance of points (..., 3) to triangles (..., 3, 3): the least over the plane and edges.

    A triangle without area is its edges.
    """
    a, b, c = np.moveaxis(corners, -2, 0)
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(-1)
    edges = np.stack([_segment_distance(points, *ends) for ends in ((a, b), (b, c), (c, a))])
    sides = [
        (np.cross(end - start, points - start) * normal).sum(-1) >= 0
        for start, end in ((a, b), (b, c), (c, a))
    ]
    above = np.logical_and.reduce(sides) & (square > 0)
    height = np.abs(((points - a) * normal).sum(-1)) / np.sqrt(np.where(square > 0, square, 1.0))
    nearest: Floats = np.where(above, height, edges.min(0))
    return nearest


def _segment_distance(points: Floats, start: Floats, end: Floats) -> Floats:
    along = end - start
    square = (along**2).sum(-1)
    share = ((points - start) * along).sum(-1) / np.where(square > 0, square, 1.0)
    foot = start + share.clip(0, 1)[..., None] * along
    distance: Floats = np.linalg.norm(points - foot, axis=-1)
    return distance
