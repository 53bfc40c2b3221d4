"""Shading normals of a surface in motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from perfcap.actor.template import Template

Floats = NDArray[np.float64]


class SeamlessNormals:
    """Unit normals weighted by area, the same on both sides of a texture seam."""

    def __init__(self, template: Template) -> None:
        self._faces = template.faces
        self._weld, representative = template.weld()
        corners = self._weld[template.faces].ravel()
        triangles = np.repeat(np.arange(len(template.faces)), 3)
        shape = (len(representative), len(template.faces))
        self._around = csr_array((np.ones(len(corners)), (corners, triangles)), shape=shape)

    def __call__(self, vertices: NDArray[Any]) -> Floats:
        """Normals (V, 3) of vertices (V, 3); +y where a vertex has no area around it."""
        corners = vertices.astype(np.float64)[self._faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        total = self._around @ area
        length = np.linalg.norm(total, axis=1, keepdims=True)
        normals: Floats = np.where(length > 0, total / np.where(length > 0, length, 1), (0, 1, 0))
        return normals[self._weld]
