"""What a chart of the page holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Line:
    """One value a frame; NaN where there is none.

    Attributes:
        name: for the legend.
        values: one a frame.
        limits: least and most that the value can be, or None.
    """

    name: str
    values: Sequence[float]
    limits: tuple[float, float] | None = None

    def plain(self) -> dict[str, Any]:
        """For JSON; values to four digits."""
        found: dict[str, Any] = {"name": self.name, "values": _plain(self.values)}
        if self.limits is not None and np.isfinite(self.limits).all():
            found["limits"] = _plain(self.limits)
        return found


@dataclass(frozen=True)
class Chart:
    """Lines that share an axis.

    Attributes:
        title: what is shown.
        unit: of the values.
        lines: one or several, of the same frames.
        about: what it means, one sentence.
        worst: a frame is bad where any line is ``high``, any is ``lowest``, the last one is
            ``low``, or any is nearest to its ``limit``.
        stacked: whether lines add up.
        group: part of the page, ``frames`` or ``angles``.
    """

    title: str
    unit: str
    lines: tuple[Line, ...]
    about: str
    worst: str = "high"
    stacked: bool = False
    group: str = "frames"

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "title": self.title,
            "unit": self.unit,
            "about": self.about,
            "worst": self.worst,
            "stacked": self.stacked,
            "group": self.group,
            "lines": [line.plain() for line in self.lines],
        }


def _plain(values: Sequence[float]) -> list[float | None]:
    return [float(f"{value:.4g}") if np.isfinite(value) else None for value in values]
