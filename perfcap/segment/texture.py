"""Points of a person that look the same in two frames of a view (Liu et al. 2013, Sec. 4.1.1)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.trimap import bounds

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_MARGIN = 8  # px around a mask, for the filters
_MOST = 800  # features of a person in a view
_CONTRAST = 0.02  # half of what photographs are looked through with: clothes have weak folds


@dataclass(frozen=True, eq=False)
class Features:
    """SIFT features of a person in one view (Lowe 2004).

    Attributes:
        points: (N, 2) px of the image.
        descriptors: (N, 128).
    """

    points: NDArray[np.float64]
    descriptors: NDArray[np.float32]


def find_features(image: Image, mask: Mask) -> Features:
    """Features whose middle is in a mask (H, W) of an RGB image (H, W, 3)."""
    none = Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    if not mask.any():
        return none
    part = bounds(mask, _MARGIN)
    gray = cv2.cvtColor(np.ascontiguousarray(image[part]), cv2.COLOR_RGB2GRAY)
    inside = np.ascontiguousarray(mask[part]).view(np.uint8)
    finder = cv2.SIFT.create(nfeatures=_MOST, contrastThreshold=_CONTRAST)
    found, descriptors = finder.detectAndCompute(gray, inside)
    if not found:
        return none
    corner = part[1].start, part[0].start
    points = np.array([each.pt for each in found], np.float64) + corner
    return Features(points, descriptors)


def match_features(
    before: Features, after: Features, reach: float, ratio: float = 0.8
) -> NDArray[np.int64]:
    """Pairs (P, 2) of indices of features that are each other's best and no second is near.

    Args:
        before: of one frame.
        after: of another.
        reach: px that a point may move.
        ratio: largest distance of descriptors, as a share of that of the second best.
    """
    if not len(before.points) or not len(after.points):
        return np.zeros((0, 2), np.int64)
    apart = np.linalg.norm(before.points[:, None] - after.points[None], axis=-1)
    one, other = before.descriptors, after.descriptors
    lengths = np.square(one).sum(1)[:, None] + np.square(other).sum(1)
    unlike = np.sqrt(np.maximum(lengths - 2 * one @ other.T, 0))
    unlike = np.where(apart <= reach, unlike, np.float32(np.inf))
    best = unlike.argmin(1)
    rows = np.arange(len(best))
    least = unlike[rows, best]
    rest = unlike.copy()
    rest[rows, best] = np.inf
    second = rest.min(1)
    mutual = unlike.argmin(0)[best] == rows
    kept = np.isfinite(least) & mutual & (least <= ratio * second)
    return np.stack([rows[kept], best[kept]], 1)
