"""Overlap of silhouettes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MaskOverlap:
    """How well a mask covers the truth, each from 0 to 1.

    Attributes:
        iou: intersection over union.
        precision: share of the mask that is true.
        recall: share of the truth that is in the mask.
    """

    iou: float
    precision: float
    recall: float


def mask_overlap(mask: NDArray[np.bool_], truth: NDArray[np.bool_]) -> MaskOverlap:
    """Compare a mask (H, W) with the truth; what is empty on both sides agrees."""
    both = int(np.count_nonzero(mask & truth))
    found, real = int(np.count_nonzero(mask)), int(np.count_nonzero(truth))

    def share(of: int) -> float:
        return both / of if of else float(not (found or real))

    return MaskOverlap(share(found + real - both), share(found), share(real))
