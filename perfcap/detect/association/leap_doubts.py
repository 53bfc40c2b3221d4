"""People whose tracks go over to somebody else: one leaves, and another comes in near by."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS

_TRUNK = [[LANDMARKS.index(f"{side}_{part}") for side in "lr"] for part in ("hip", "shoulder")]
_WINDOW, _FEWEST = 6, 4  # frames whose way is continued, and how many of them must be known
_FASTER = 20.0  # m/s2, that people may be faster or slower by while they are not seen
# m, between ways of the trunk before and after, beyond that
_LEAP = 0.33
_USUAL = 8.0  # times that of most frames: of two views, points may be noisy


def leap_doubts(points: Tensor, rate: float) -> Iterator[str]:
    """A sentence about each person whose trunk is not where it was going.

    The ways of hips and shoulders before and after are continued to the moment between by straight
    lines; a person's own ways meet there.

    Args:
        points: joints of everybody, (P, F, 16, 3) metres, NaN where unknown.
        rate: frames a second.
    """
    for person, joints in enumerate(points.detach().cpu().double().numpy(), 1):
        # a joint that is wrong moves one of them
        hips, shoulders = (_leaps(joints[:, part].mean(1), rate) for part in _TRUNK)
        both = {at: min(hips[at], shoulders[at]) for at in hips.keys() & shoulders.keys()}
        usual = float(np.median(list(both.values()))) if both else 0.0
        far = {at: away for at, away in both.items() if away > max(_LEAP, _USUAL * usual)}
        if far:
            (last, first), away = max(far.items(), key=lambda item: item[1])
            yield (
                f"person {person} leaps {away:.1g} m aside between frames {last} and {first} "
                "(counted from 0): has one left and another come in? Look at the overlay, and "
                "capture such parts one at a time"
            )


def _leaps(places: NDArray[np.float64], rate: float) -> dict[tuple[int, int], float]:
    """How far ways (F, 3) before and after two frames that follow one another miss, metres.

    Of frames that are known, and have enough of them on either side; less what people may be
    faster by in the time between.
    """
    known = np.flatnonzero(np.isfinite(places).all(-1))
    found = {}
    for last, first in zip(known[:-1].tolist(), known[1:].tolist(), strict=True):
        before = known[(known <= last) & (known > last - _WINDOW)]
        after = known[(known >= first) & (known < first + _WINDOW)]
        if min(len(before), len(after)) >= _FEWEST:
            middle, time = 0.5 * (last + first), (first - last) / rate
            ends = [np.polyfit(part - middle, places[part], 1)[1] for part in (before, after)]
            away = float(np.linalg.norm(ends[0] - ends[1]))
            found[last, first] = away - _FASTER * (0.5 * time) ** 2
    return found
