"""Vertices of a clip in 16 bits a coordinate, and in a few bytes once deflated.

Coordinates are multiples of a step from the corner of the box that the clip stays in. Neighbours
in time and in the order of the vertices move alike, so what is stored is the difference in both,
modulo 2^16, and of it first all low bytes, then all high ones, which are nearly always zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

STEP = 1e-4  # m: as fine as a step needs to be; coarser only in boxes above 6.5 m
_LEVELS = 2**16 - 1

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Box:
    """The grid that coordinates are rounded to.

    Attributes:
        origin: smallest coordinates of the clip, (3,) m.
        step: m; positions are off by half of it at most, along each axis.
    """

    origin: NDArray[np.float64]
    step: float

    @classmethod
    def around(cls, low: Floats, high: Floats) -> Self:
        """The grid of a clip between two corners, (3,) m."""
        origin = np.asarray(low, np.float64)
        return cls(origin, max(STEP, float((high - origin).max()) / _LEVELS))

    def levels(self, positions: Floats) -> NDArray[np.uint16]:
        """Nearest places on the grid of positions (..., 3) m."""
        return np.rint((positions - self.origin) / self.step).clip(0, _LEVELS).astype(np.uint16)

    def positions(self, levels: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Places on the grid, (..., 3) m."""
        return self.origin + self.step * levels


def difference(levels: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Coded differences, (2, 3, F, V), of levels (F, V, 3).

    For a viewer to read: for each axis, frame and vertex a number n = low + 256 high; the
    difference is n / 2, or -(n + 1) / 2 where n is odd.
    """
    values = levels.transpose(2, 0, 1)  # 3 F V
    change = values.copy()
    change[:, 1:] -= values[:, :-1]
    change[:, :, 1:] -= change[:, :, :-1].copy()
    signed = change.view(np.int16)
    folded = ((signed << 1) ^ (signed >> 15)).view(np.uint16)
    return np.stack([folded & 0xFF, folded >> 8]).astype(np.uint8)


def restore(coded: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """The levels (F, V, 3) of coded differences (2, 3, F, V): the inverse of ``difference``."""
    folded = coded[0].astype(np.uint16) | (coded[1].astype(np.uint16) << 8)
    change = (folded >> 1) ^ (-(folded & 1).astype(np.int16)).view(np.uint16)
    levels = change.cumsum(2, np.uint16).cumsum(1, np.uint16)
    return np.ascontiguousarray(levels.transpose(1, 2, 0))
