"""The boundary of a mask, sub-pixel, with normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Contour:
    """Boundary of a silhouette in one frame and view.

    Attributes:
        points: (N, 2) px, between the centres of inside and outside pixels.
        normals: (N, 2), unit, outward.
        confidence: (N,), 0 to 1.
    """

    points: Floats
    normals: Floats
    confidence: Floats

    def __len__(self) -> int:
        return len(self.points)
