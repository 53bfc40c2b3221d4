"""Limbs of a pose that stand out of the silhouette, and of the silhouette out of the pose."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from perfcap.pipeline.evidence import Evidence, Mask
from perfcap.pipeline.sight import Outline

_NEAR = 2.0  # percent of the person's height about a mask: hands, clothes and masks are that wrong


def frame_excess(drawn: Sequence[Outline], evidence: Evidence, frame: int) -> tuple[float, float]:
    """What a posed body and its masks show beside each other, percent of the squared height.

    A forearm has 0.9, a lower leg 2. Clothes and hair that a body lacks only make masks larger.

    Args:
        drawn: outlines of the surface in C views.
        evidence: masks.
        frame: its number.

    Returns:
        The largest part of the body that no mask explains, and of masks that no body does: means
        over views, 0 where a view has no mask or shows nothing of the body.
    """
    units = evidence.pixel_unit.tolist()
    views = zip(drawn, evidence.masks(frame), units, strict=True)
    beyond, unexplained = np.mean([_excess(*view) for view in views], 0).tolist()
    return beyond, unexplained


def _excess(outline: Outline, mask: Mask, unit: float) -> tuple[float, float]:
    if not mask.any() or not outline.seen.any():
        return 0.0, 0.0
    seen = outline.mask
    rows, columns = (np.flatnonzero((seen | mask).any(axis)) for axis in (1, 0))
    margin = int(_NEAR * unit) + 2
    part = tuple(
        slice(max(0, int(where[0]) - margin), int(where[-1]) + margin + 1)
        for where in (rows, columns)
    )
    seen, mask = seen[part], mask[part]
    return _largest(seen, mask, unit), _largest(mask, seen, unit)


def _largest(one: Mask, other: Mask, unit: float) -> float:
    """The largest part of one that is not near another."""
    apart = cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    left = (one & (apart > _NEAR * unit)).astype(np.uint8)
    areas = cv2.connectedComponentsWithStats(left)[2][1:, cv2.CC_STAT_AREA]
    return float(areas.max(initial=0)) / (100.0 * unit) ** 2 * 100.0
