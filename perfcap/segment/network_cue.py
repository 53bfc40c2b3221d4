"""A network's person mask as one cue among others, trusted as far as they agree with it.

What a network calls sure may mean little in a clip it was not made for: to it a portrait on the
wall is a person, and a coat is none. So its log odds are not added as they are. In some frames the
person is found without it; how often pixels of each log odds then belong to the person says how
many nats they are worth in this clip: ln p(odds | person) / p(odds | background), over pixels that
the posed model leaves open. Where other cues contradict it as often as not it is worth nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from perfcap.segment.trimap import Box, Mask

Plane = NDArray[np.float32]

_BINS = 12
_SPREAD = 300.0  # pixels of either side that every bin is taken to have: few say little


class PersonNetwork(Protocol):
    """What finds person masks; ``perfcap.detect.segmenter.OnnxSegmenter`` is one."""

    def __call__(
        self, image: NDArray[np.uint8], model: Mask, spine: NDArray[np.floating], part: Box
    ) -> Plane:
        """Log odds of the person in a part (h, w) of an image (H, W, 3).

        Args:
            image: RGB.
            model: about where the person is, (h, w).
            spine: neck and middle of the hips, (2, 2) px.
            part: rows and columns wanted.
        """


@dataclass(frozen=True)
class CueTrust:
    """Nats that log odds of a network are worth in a clip, linear between knots.

    Attributes:
        odds: knots, rising, (n,).
        nats: at the knots, none falling, (n,).
    """

    odds: NDArray[np.float64]
    nats: NDArray[np.float64]

    def __call__(self, odds: Plane) -> Plane:
        """Nats in favour of the person, of log odds of any shape."""
        nats: Plane = np.interp(odds, self.odds, self.nats).astype(np.float32)
        return nats


def learn_trust(samples: Iterable[tuple[Plane, Mask]], limit: float) -> CueTrust | None:
    """How far to trust a network's log odds.

    Args:
        samples: log odds of open pixels, (n,), and whether they belong to the person as other
            cues have it, (n,).
        limit: nats at most.

    Returns:
        None without any pixels of either side.
    """
    pairs = list(samples)
    odds = np.concatenate([pair[0].ravel() for pair in pairs]) if pairs else np.zeros(0)
    person = np.concatenate([pair[1].ravel() for pair in pairs]) if pairs else np.zeros(0, np.bool_)
    if not person.any() or person.all():
        return None
    edges = np.unique(np.quantile(odds, np.linspace(0, 1, _BINS + 1)))
    if len(edges) < 2:
        return None
    if len(edges) == 2:  # a mask of two values
        edges = np.insert(edges, 1, edges.mean())
    bins = np.clip(np.searchsorted(edges, odds, "right") - 1, 0, len(edges) - 2)
    sides = person, ~person
    counts = np.stack([np.bincount(bins[side], minlength=len(edges) - 1) for side in sides])
    shares = (counts + _SPREAD / counts.shape[1]) / (counts.sum(1, keepdims=True) + _SPREAD)
    evidence = np.log(shares[0] / shares[1])
    nats = isotonic_regression(evidence, weights=counts.sum(0) + 1.0).x
    centers = np.array(
        [np.median(odds[bins == b]) if (bins == b).any() else edges[b] for b in range(len(nats))]
    )
    chosen = np.concatenate(([True], np.diff(centers) > 0))
    return CueTrust(centers[chosen], np.clip(nats, -limit, limit)[chosen])
