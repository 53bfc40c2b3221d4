"""Small meshes around the synthetic skeleton."""

from __future__ import annotations

import numpy as np
import synthetic
import trimesh
from numpy.typing import NDArray

from perfcap.rigging.bones import Bones, skeleton_bones

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def positions() -> dict[str, Floats]:
    return {name: place.numpy() for name, place in synthetic.rest_positions().items()}


def bones() -> Bones:
    return skeleton_bones(positions())


def tube(start: str, end: str, radius: float = 0.05, sections: int = 12) -> trimesh.Trimesh:
    """A closed tube along a bone, in rings of 2 cm."""
    at = positions()
    segment = np.stack((at[start], at[end]))
    length = float(np.linalg.norm(segment[1] - segment[0]))
    mesh = trimesh.creation.cylinder(radius=radius, segment=segment, sections=sections)
    return mesh.subdivide_to_size(max(0.03, length / 30))


def sleeve(start: str, end: str, radius: float) -> trimesh.Trimesh:
    """A tube without its caps."""
    mesh, at = tube(start, end, radius), positions()
    along = (at[end] - at[start]) / np.linalg.norm(at[end] - at[start])
    mesh.update_faces(np.abs(mesh.face_normals @ along) < 0.5)
    mesh.remove_unreferenced_vertices()
    return mesh


def arrays(mesh: trimesh.Trimesh) -> tuple[Floats, Integers]:
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
