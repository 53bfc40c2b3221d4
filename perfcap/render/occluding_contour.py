"""Points of a mesh that make contours in an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class ModelContour:
    """Visible contour of a mesh in one frame and view.

    Attributes:
        points: (P, 2) px.
        normals: (P, 2), unit, outward: away from the surface the point lies on.
        vertices: (P, 2) int64, the two vertices a point lies between.
        weights: (P, 2), their shares in space, rows sum to one.
        outer: (P,) bool, True on the boundary of the model's silhouette (background beyond it),
            False where the surface stands in front of other surface.
    """

    points: Floats
    normals: Floats
    vertices: Integers
    weights: Floats
    outer: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.points)
