"""Whether frames came in the order of their names as text (1, 10, 11, 2), or in none at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import fmean

import torch
from torch import Tensor

from perfcap.detect.extent import end_to_end

SURE = 0.3
"""Confidence of joints that are looked at."""


@dataclass(frozen=True)
class Steps:
    """How joints go from one frame to the next.

    Attributes:
        length: mean over those that are known; NaN of too few.
        known: of how many it is the mean.
    """

    length: float
    known: int


Way = Callable[[Tensor], Steps]
"""Steps in an order of frames (F,)."""

_FEWEST = 20  # frames: who swings back within a dozen is as near in another order
_SHORTER = 0.7  # of the way as given; of noise alone it is the same
# Of the steps known as given: whoever is seen in a part of the clip is so in frames that follow one
# another, and fewer steps than that, of other frames, may be short ones
_AS_MANY = 0.95
# Steps of a joint from frame to frame, of those between frames in any order: 0.68 at most in parts
# of 12 frames and more of ten recordings, 0.72 in parts of eight in which the person moves so far
_SHUFFLED = 0.85
# Of the person's height, between frames in any order, by frames: less may be errors of joints
_MOVED = {12: 0.05, 8: 0.1}
_ORDERS = 4  # that are tried


def sorted_as_text(way: Way, count: int) -> float | None:
    """How far joints go once frames are sorted by their numbers, of the way as given.

    Args:
        way: of an order.
        count: of frames.

    Returns:
        None where frames are in order already, or too few.
    """
    if count < _FEWEST:
        return None
    given = way(torch.arange(count))
    for start in (0, 1):  # of the numbers in the names
        numbers = sorted(range(start, start + count), key=str)
        found = way(torch.tensor(numbers).argsort())
        share = found.length / given.length if given.length > 0 else 1.0
        if share < _SHORTER and found.known >= _AS_MANY * given.known:
            return share
    return None


def in_no_order(way: Way, count: int, height: float, seen: int | None = None) -> float | None:
    """How far joints go from one frame to the next, of the way between any two.

    Args:
        way: of an order.
        count: of frames.
        height: of the person, in the unit of the way.
        seen: how many of the frames show somebody; all if not given.

    Returns:
        None where frames follow one another, or that is unknown.
    """
    seen = count if seen is None else seen
    moved = next((share for least, share in _MOVED.items() if seen >= least), torch.inf)
    if not 0 < moved * height < torch.inf:
        return None
    random = torch.Generator().manual_seed(0)
    orders = [torch.randperm(count, generator=random) for _ in range(_ORDERS)]
    mixed, given = fmean(way(order).length for order in orders), way(torch.arange(count)).length
    return given / mixed if mixed > moved * height and given > _SHUFFLED * mixed else None


def person_height(joints: Tensor, confidence: Tensor) -> float:
    """Median size of people (*b, 16, D) who are seen, from end to end; NaN where none is sure.

    Args:
        joints: (*b, 16, D).
        confidence: (*b, 16).
    """
    sure = confidence > SURE
    return float(end_to_end(joints, sure)[sure.any(-1)].median()) if sure.any() else float("nan")
