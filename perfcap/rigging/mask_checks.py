"""Whether masks are of the person whose joints are detected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.rigging.person_masks import PersonMasks

LEAST_INSIDE = 0.5
"""Share of the sure joints that lie in one's own silhouette."""

_SURE = 0.3  # confidence from which a joint counts
_FEWEST, _HARDLY = 4, 0.1  # frames, and share of them, in which a joint is held
_LIMBS = [k for k, name in enumerate(LANDMARKS) if name[2:] in ("elbow", "knee", "ankle")]


def joints_inside(detections: Detections, masks: PersonMasks) -> Tensor:
    """Share of the sure joints of each view that lie in the mask, (C,); 1 without joints.

    Args:
        detections: (F, C), in pixels of the masks.
        masks: of the same frames.
    """
    held, counted = _held(detections, masks)
    share = held.sum((0, 2)) / counted.sum((0, 2)).clamp(min=1)
    return torch.where(counted.any(-1).any(0), share.double(), 1.0)


def others_doubts(
    names: Sequence[str], detections: Detections, masks: PersonMasks
) -> Iterator[str]:
    """Sentences about views whose masks are of somebody or something else.

    Args:
        names: of the views.
        detections: (F, C), in pixels of the masks.
        masks: of the same frames.
    """
    for name, share in zip(names, joints_inside(detections, masks).tolist(), strict=True):
        if share < LEAST_INSIDE:
            yield (
                f"masks of {name}: hold {100 * share:.0f} % of the detected joints; expected those "
                "of the person that the joints belong to"
            )


def limb_doubts(names: Sequence[str], detections: Detections, masks: PersonMasks) -> Iterator[str]:
    """Sentences about views whose masks end before limbs that are seen there.

    Args:
        names: of the views.
        detections: (F, C), in pixels of the masks.
        masks: of the same frames.
    """
    shares = joints_inside(detections, masks).tolist()
    for name, share, limbs in zip(names, shares, _left_out(detections, masks), strict=True):
        if share >= LEAST_INSIDE and limbs:
            yield (
                f"masks of {name}: leave out {', '.join(limbs)}; expected all of the person: is a "
                "part cut off, or hidden by something?"
            )


def _left_out(detections: Detections, masks: PersonMasks) -> list[list[str]]:
    """Elbows, knees and ankles of each view that the masks of hardly any frame hold."""
    held, counted = (part.sum(0) for part in _held(detections, masks))  # C 16
    never = (counted >= _FEWEST) & (held < _HARDLY * counted)
    return [[LANDMARKS[k] for k in _LIMBS if row[k]] for row in never.tolist()]


def _held(detections: Detections, masks: PersonMasks) -> tuple[Tensor, Tensor]:
    """Sure joints that lie in the mask, and those that lie in the image, (F, C, 16)."""
    known = detections.joints2d.isfinite().all(-1)
    pixels = torch.where(known[..., None], detections.joints2d, -1.0).round().long()  # F C 16 2
    height, width = masks.inside.shape[-2:]
    sure = (detections.confidence2d > _SURE) & known
    within = (pixels >= 0).all(-1) & (pixels[..., 0] < width) & (pixels[..., 1] < height)
    index = pixels[..., 1].clamp(0, height - 1) * width + pixels[..., 0].clamp(0, width - 1)
    held = masks.inside.flatten(-2).gather(-1, index) > 0
    counted = sure & within
    return held & counted, counted
