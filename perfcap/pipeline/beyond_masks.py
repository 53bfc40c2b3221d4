"""Limbs of a pose that stand out of the silhouette: nothing there is the person's."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from perfcap.pipeline.evidence import Evidence, Mask
from perfcap.pipeline.sight import Outline

_NEAR = 2.0  # percent of the person's height about a mask: hands, clothes and masks are that wrong


def frame_beyond(drawn: Sequence[Outline], evidence: Evidence, frame: int) -> float:
    """The largest part of a posed body that no mask explains, percent of the squared height.

    A forearm has 0.9, a lower leg 2. Clothes and hair that a body lacks only make masks larger.

    Args:
        drawn: outlines of the surface in C views.
        evidence: masks.
        frame: its number.

    Returns:
        The mean over views; 0 where a view has no mask.
    """
    units = evidence.pixel_unit.tolist()
    views = zip(drawn, evidence.masks(frame), units, strict=True)
    return float(np.mean([_beyond(outline, mask, unit) for outline, mask, unit in views]))


def _beyond(outline: Outline, mask: Mask, unit: float) -> float:
    crop = np.ascontiguousarray(mask[outline.part])
    if not crop.any() or not outline.seen.any():
        return 0.0
    apart = cv2.distanceTransform((~crop).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    lost = (outline.seen & (apart > _NEAR * unit)).astype(np.uint8)
    areas = cv2.connectedComponentsWithStats(lost)[2][1:, cv2.CC_STAT_AREA]
    return float(areas.max(initial=0)) / (100.0 * unit) ** 2 * 100.0
