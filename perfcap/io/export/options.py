"""What can be chosen about an export, and what formats do with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

UNITS: Mapping[str, float] = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""Units of length, and how many of them a metre has."""


@dataclass(frozen=True)
class Options:
    """Choices beyond the format.

    Attributes:
        unit: of length, where the format leaves it open: a key of ``UNITS``.
        surface: whether the captured surface goes along where there is one.
        markers: whether markers are the 16 ``landmarks`` or the origins of all ``bones``.
        order: of Euler angles, such as ``ZXY``; ``auto`` takes for each joint the one whose angles
            move the least between frames.
    """

    unit: str = "m"
    surface: bool = True
    markers: str = "landmarks"
    order: str = "auto"

    @property
    def per_metre(self) -> float:
        """Units in a metre."""
        return UNITS[self.unit]
