"""GrabCut without a model, to compare with (Xu 2018, Fig. 4; MPC-22)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.trimap import FOREGROUND, PROBABLE_FOREGROUND, Mask


def box_grabcut(
    frame: NDArray[np.uint8], model: Mask, margin: float = 0.05, rounds: int = 5
) -> Mask:
    """OpenCV's GrabCut from a bounding box alone.

    Args:
        frame: (H, W, 3) RGB.
        model: silhouette (H, W) that gives the box; nothing else of it is used.
        margin: added around the box, as a share of its longer side.
        rounds: of GrabCut.
    """
    rows, columns = np.nonzero(model.any(1))[0], np.nonzero(model.any(0))[0]
    if not len(rows):
        return np.zeros(model.shape, np.bool_)
    pad = int(margin * max(np.ptp(rows), np.ptp(columns)))
    top, left = max(int(rows[0]) - pad, 0), max(int(columns[0]) - pad, 0)
    bottom = min(int(rows[-1]) + pad + 1, model.shape[0])
    right = min(int(columns[-1]) + pad + 1, model.shape[1])
    if (bottom - top) * (right - left) >= model.size:  # nothing outside to learn from
        return np.ones(model.shape, np.bool_)
    labels = np.zeros(model.shape, np.uint8)
    cv2.setRNGSeed(0)
    state = np.zeros((1, 65)), np.zeros((1, 65))
    box = (left, top, right - left, bottom - top)
    cv2.grabCut(np.ascontiguousarray(frame), labels, box, *state, rounds, cv2.GC_INIT_WITH_RECT)
    found: Mask = (labels == FOREGROUND) | (labels == PROBABLE_FOREGROUND)
    return found
