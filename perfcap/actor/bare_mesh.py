"""A textured mesh without bones: what a scanner or a modeller saves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError


@dataclass(frozen=True, eq=False)
class BareMesh:
    """Triangles in whatever units and axes their file has.

    Attributes:
        vertices: split where texture jumps, (V, 3).
        faces: vertex indices, counter-clockwise seen from outside, (T, 3).
        uv: texture coordinates with the origin at the top left, (V, 2), or None.
        texture: an encoded JPEG or PNG, or None.
        name: what to call it.
        parts: name and number of vertices of each mesh that a file has, in the order of the
            vertices; empty where a file has no such names.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    uv: NDArray[np.float64] | None = None
    texture: bytes | None = None
    name: str = "mesh"
    parts: tuple[tuple[str, int], ...] = ()

    def __post_init__(self) -> None:
        vertices, faces = np.array(self.vertices, np.float64), np.array(self.faces, np.int64)
        if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not np.isfinite(vertices).all():
            raise self._bad("vertices", f"{vertices.shape}", "finite (V, 3)")
        if not len(faces):
            raise InputError(
                f"mesh {self.name!r}: has no faces; give a mesh, not a cloud of points"
            )
        if faces.ndim != 2 or faces.shape[1:] != (3,):
            raise self._bad("faces", f"{faces.shape}", "triangles (T, 3)")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise self._bad("faces", f"{faces.min()} to {faces.max()}", "indices of vertices")
        if self.uv is not None:
            uv = np.array(self.uv, np.float64)
            if uv.shape != (len(vertices), 2) or not np.isfinite(uv).all():
                raise self._bad("uv", f"{uv.shape}", f"finite ({len(vertices)}, 2)")
            object.__setattr__(self, "uv", uv)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    def _bad(self, name: str, found: str, expected: str) -> InputError:
        return InputError(f"mesh {self.name!r}: {name} are {found}; expected {expected}")
