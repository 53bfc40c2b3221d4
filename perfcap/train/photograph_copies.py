"""Whether joints are counted in these very photographs, or in smaller copies or cut-out boxes.

Photographers put people in the middle. Pixels of smaller copies, and those counted from the corner
of each person's box, are nearer to the upper left corner. One person says nothing of it, many do.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from perfcap.errors import InputError
from perfcap.train.photograph_checks import PEOPLE, Floats, stretches

# Of lspet, middles of people are at 0.50 of the width and 0.44 of the height, and deviate by 0.10.
_MIDDLE, _BESIDE, _DEVIATIONS, _LEAST = 0.5, 0.04, 4.0, 0.1
_HIGH = 0.47  # of the height: on one camera's floor people stay below, wherever they are
_REACH, _FARTHEST = 0.93, 98  # of the sides, and percentage of people
# Ranges of people's corners and sizes, in sizes: of lspet 0.9 and more, and 0.7.
_SAME, _OTHER = 0.1, 0.2
_RANGE = (10, 90)  # percentages of people


def require_whole(path: Path, joints: Floats, sizes: Floats) -> None:
    """Refuse joints of smaller copies of photographs, or counted from a box around each person.

    Args:
        path: of the annotations.
        joints: (N, 16, 2), pixels, NaN where unknown, of each person one or more known.
        sizes: width and height of each photograph, (N, 2).

    Raises:
        InputError: says what is odd of the places.
    """
    if len(joints) < PEOPLE:
        return
    low, high = np.nanmin(joints, 1), np.nanmax(joints, 1)
    _require_no_box(path, low, high, sizes)
    middles = 0.5 * (low + high) / sizes
    across, down = (float(value) for value in middles.mean(0))
    spread = max(_LEAST, float(middles[:, 0].std())) / np.sqrt(len(joints))
    limit = _MIDDLE - _BESIDE - _DEVIATIONS * spread
    reach = np.percentile(high / sizes, _FARTHEST, axis=0)
    if across < limit and down < _HIGH and (reach < _REACH).all():
        raise InputError(
            f"{path}: people are at {across:.0%} of the width of their photographs in the mean and "
            f"reach {reach[0]:.0%} of it; expected {limit:.0%} or more, about the middle: pixels "
            f"of these very files (are they of copies about {2 * across:.1f} times as large, or "
            "counted from a box?)"
        )


def _require_no_box(path: Path, low: Floats, high: Floats, sizes: Floats) -> None:
    """Refuse joints between two corners (N, 2) of which the first is everybody's, large or small.

    Photographs that were cut out around people have as much room behind the second corner too.
    """
    spans = (high - low).max(-1)
    room = (sizes - high) / np.median(spans)
    for part in stretches(len(low)):
        size = float(np.median(spans[part]))
        first, behind = (_range(values[part]) for values in (low / size, room))
        same = (first < _SAME).all() and (behind > _OTHER).all()
        if size > 0 and same and float(_range(spans[part] / size)) > _OTHER:
            where = (
                ""
                if part.stop - part.start == len(low)
                else (f"of people {part.start} to {part.stop - 1} of the list, ")
            )
            x, y = np.median(low[part], 0)
            raise InputError(
                f"{path}: {where}joints of small and of large people all begin at about {x:.0f}, "
                f"{y:.0f}; expected pixels of the photographs: add the corner of each one's box"
            )


def _range(values: Floats) -> Floats:
    """Between percentages of people, (N, ...) to (...)."""
    low, high = np.percentile(values, _RANGE, axis=0)
    return np.asarray(high - low, np.float32)
