"""Curves over time, drawn without a plotting library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_SIZE = (420, 960)  # height and width, px
_MARGIN = (48, 56)
_INK, _GRID = (40, 40, 40), (225, 225, 225)
# distinct in hue and in lightness, blue green red as cv2 has them
_COLORS = ((180, 119, 31), (14, 127, 255), (44, 160, 44), (40, 39, 214), (189, 103, 148))


@dataclass(frozen=True)
class Curve:
    """One value a frame."""

    name: str
    values: Sequence[float]


def draw_curves(curves: Sequence[Curve], title: str, every: int = 1) -> NDArray[np.uint8]:
    """A picture of curves over frames, each with its mean in the legend.

    Args:
        curves: of equal length.
        title: what is drawn, and its unit.
        every: frames between values.
    """
    height, width = _SIZE
    top, left = _MARGIN
    picture = np.full((height, width, 3), 255, np.uint8)
    highest = 1.05 * max(max(curve.values) for curve in curves)
    count = len(curves[0].values)

    def place(index: float, value: float) -> tuple[int, int]:
        x = left + (width - left - 16) * index / max(count - 1, 1)
        y = height - top + (2 * top - height) * value / highest
        return round(x), round(y)

    for tick in np.linspace(0, highest, 6):
        cv2.line(picture, place(0, tick), place(count - 1, tick), _GRID, 1)
        _write(picture, f"{tick:.0f}", (8, place(0, tick)[1] + 4))
    for tick in np.linspace(0, count - 1, min(count, 6)).astype(int):
        _write(picture, str(tick * every), (place(tick, 0)[0] - 8, height - top + 20))
    _write(picture, title, (left, 22))
    for number, curve in enumerate(curves):
        color = _COLORS[number % len(_COLORS)]
        line = np.array([place(i, value) for i, value in enumerate(curve.values)])
        cv2.polylines(picture, [line.astype(np.int32)], False, color, 2, cv2.LINE_AA)
        label = f"{curve.name} {np.mean(curve.values):.1f}"
        _write(picture, label, (left + 220 * number, height - 10), color)
    return picture


def _write(
    picture: NDArray[np.uint8],
    text: str,
    at: tuple[int, int],
    color: tuple[int, int, int] = _INK,
) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.48, color, 1, cv2.LINE_AA)
