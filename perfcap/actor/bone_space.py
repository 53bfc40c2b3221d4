"""How a file measures its bones.

Characters are modelled in metres, centimetres or inches, with y or z up, and under armatures that
are scaled or turned. An actor is always in metres with y up; what the file had is kept beside it,
so that animations can be written in the file's own numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError

Floats = NDArray[np.float64]

_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class BoneSpace:
    """The space that the bones of a file move in.

    Attributes:
        units: metres in a unit of each bone's own axes, in which its children are placed, (B,).
        frame: similarity from the space of the root bones to the world in metres, (4, 4).
    """

    units: Floats
    frame: Floats

    def __post_init__(self) -> None:
        for name, ndim in (("units", 1), ("frame", 2)):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.ndim != ndim or not np.isfinite(array).all():
                raise InputError(f"bone space: {name} has shape {array.shape} or is not finite")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if not is_similarity(self.frame) or np.any(self.units <= 0):
            raise InputError("bone space: expected positive units, and a frame without shear")

    def scaled(self, rigid: Floats) -> Floats:
        """Transforms (..., B, 4, 4) of bones to the world, with their units."""
        frames = np.array(rigid)
        frames[..., :3, :3] *= self.units[:, None, None]
        return frames

    def moved(self, similarity: Floats) -> BoneSpace:
        """The space after a similarity (4, 4) of the world has been applied to everything."""
        factor = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
        return BoneSpace(self.units * factor, similarity @ self.frame)

    def is_plain(self) -> bool:
        """Whether it is metres in the world."""
        return bool(np.all(self.units == 1) and np.array_equal(self.frame, np.eye(4)))


def is_similarity(matrix: Floats) -> bool:
    """Whether a matrix (4, 4) turns, moves and scales evenly, without mirroring."""
    linear = matrix[:3, :3]
    square = linear.T @ linear
    size = float(np.trace(square)) / 3
    even = size > 0 and np.abs(square - size * np.eye(3)).max() < _TOLERANCE * size
    return bool(even and np.linalg.det(linear) > 0 and np.allclose(matrix[3], (0, 0, 0, 1)))
