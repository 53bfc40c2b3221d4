"""Shapes of robots as triangles: boxes, spheres, cylinders, capsules and meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, require_file

Floats = NDArray[np.float64]
Surface = tuple[Floats, NDArray[np.int64]]

READ = (".stl", ".obj", ".ply")  # meshes; those of others are left out
_LARGEST = 64 * MEBIBYTE
_MOST = 2000  # vertices of a mesh above which its convex hull stands for it
_ROUND = 12  # corners of what is round


def box(half: Floats) -> Surface:
    """A box of half sizes (3,)."""
    return _of(_trimesh().creation.box(extents=2 * half))


def sphere(radius: float) -> Surface:
    """A sphere about the origin."""
    return ellipsoid(np.full(3, radius))


def ellipsoid(radii: Floats) -> Surface:
    """An ellipsoid of three radii, (3,)."""
    ball = _trimesh().creation.uv_sphere(1.0, count=(_ROUND, _ROUND))
    ball.apply_scale(radii)
    return _of(ball)


def cylinder(radius: float, half: float) -> Surface:
    """A cylinder along z, of half a length."""
    return _of(_trimesh().creation.cylinder(radius, 2 * half, sections=_ROUND))


def capsule(radius: float, half: float) -> Surface:
    """A cylinder along z with round ends, which half the length leaves out."""
    ball = _trimesh().creation.uv_sphere(radius, count=(_ROUND, _ROUND))
    vertices = np.asarray(ball.vertices, dtype=np.float64).copy()
    vertices[:, 2] += np.where(vertices[:, 2] >= 0, half, -half)
    return vertices, np.asarray(ball.faces, dtype=np.int64)


def mesh(path: Path, scale: Floats) -> Surface | None:
    """Triangles of a file, or of its convex hull where it has many; None of other formats.

    Raises:
        InputError: it is missing, too large, or damaged.
    """
    if path.suffix.lower() not in READ:
        return None
    require_file(path, _LARGEST, "a mesh of a robot")
    try:
        found = _trimesh().load(path, force="mesh", process=True, skip_materials=True)
        if len(found.vertices) > _MOST:
            found = found.convex_hull
    except Exception as error:  # readers of meshes raise anything
        raise InputError(f"{path}: is no mesh that can be read ({error!s:.80})") from error
    vertices, faces = _of(found)
    if not len(faces) or not np.isfinite(vertices).all():
        raise InputError(f"{path}: has no triangles, or places that are no numbers")
    return vertices * scale, faces


def moved(surface: Surface, pose: Floats) -> Surface:
    """A surface in other axes, (4, 4)."""
    vertices, faces = surface
    return vertices @ pose[:3, :3].T + pose[:3, 3], faces


def stick(start: Floats, end: Floats, thick: float) -> Surface:
    """A thin box between two points."""
    along = end - start
    length = float(np.linalg.norm(along))
    pose = np.eye(4)
    pose[:3, :3] = frame_along(along / length)
    pose[:3, 3] = 0.5 * (start + end)
    return moved(box(np.array([thick, thick, 0.5 * length])), pose)


def frame_along(z: Floats) -> Floats:
    """A rotation (3, 3) whose last column is a unit vector."""
    other = np.eye(3)[int(np.abs(z).argmin())]
    x = np.cross(other, z)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(z, x), z), axis=1)


def _of(found: Any) -> Surface:
    return np.asarray(found.vertices, dtype=np.float64), np.asarray(found.faces, dtype=np.int64)


def _trimesh() -> Any:
    """Opened where a robot is read: it brings some 400 modules."""
    import trimesh

    return trimesh
