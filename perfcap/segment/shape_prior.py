"""How probable each person is at each pixel, from solved poses and how sure they are.

Liu et al. 2013, Sec. 5.2.1, Eq. 18 to 23, in closed form: their samples of poses around the last
one are replaced by the deviations of what they are drawn from, carried into the image. Every person
is drawn alone, so that a limb that is hidden keeps its probability where it may come out again. An
outline that is off by a deviation s covers a pixel at a distance d inside it with the probability
of a logistic distribution; a pixel shows a person whom nobody nearer covers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr

from perfcap.segment.person_layer import Surroundings

Plane = NDArray[np.float32]

_SLOPE = 1.8138  # of a logistic distribution of deviation one: pi / sqrt(3)
_LOOSE, _WIDE = 0.05, 4.0  # share of outlines that are further off, as of skirts, and how much
_LEAST = 1e-6  # probability of whatever is possible at all


def in_front(one: Surroundings, other: Surroundings, doubt: float) -> Plane:
    """Probability that one person is nearer to the camera than another, (h, w).

    Args:
        one: the person asked about.
        other: the other.
        doubt: deviation of the difference of their depths, m.
    """
    with np.errstate(invalid="ignore"):
        apart = np.nan_to_num((other.depth - one.depth) / max(doubt, 1e-6), posinf=9, neginf=-9)
    found: Plane = ndtr(apart).astype(np.float32)
    return found


def _covers(deviations: Plane) -> Plane:
    """Probability that an outline covers a pixel so many deviations inside of it."""
    close, loose = (expit(_SLOPE * deviations / width) for width in (1.0, _WIDE))
    covered: Plane = (1 - _LOOSE) * close + _LOOSE * loose
    return covered


def shape_prior(people: Sequence[Surroundings], doubt: float) -> Plane:
    """Probability that a pixel of anybody is one of each person, (K, h, w), of sum one.

    Args:
        people: K models around the pixels.
        doubt: deviation of the difference of two depths, m.
    """
    covers = [_covers(each.distance / each.spread) for each in people]
    shown = []
    for k, one in enumerate(people):
        free = covers[k]
        for j, other in enumerate(people):
            if j != k:
                free = free * (1 - covers[j] * in_front(other, one, doubt))
        shown.append(free + _LEAST)
    total = np.stack(shown)
    found: Plane = (total / total.sum(0)).astype(np.float32)
    return found
