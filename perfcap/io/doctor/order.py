"""Whether frames came in the order of their names as text: 1, 10, 11, 2; or in none at all."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.detect.frame_order import SURE, Steps, Way, in_no_order, person_height, sorted_as_text
from perfcap.io.doctor.finding import Finding, Severity

_PAIRS = 6  # frames after one another that both show the person


def examine_order(name: str, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Say so where joints go clearly less far once frames are sorted by their numbers.

    Args:
        name: of the view.
        pixels: joints, (F, 16, 2).
        confidence: (F, 16).
    """
    share = sorted_as_text(_way(pixels, confidence), len(pixels))
    if share is None:
        return []
    what = f"frames look sorted as text (1, 10, 2): by their numbers joints go {share:.0%} as far"
    return [Finding(Severity.WARNING, name, what, "sort names by the numbers in them")]


def examine_shuffled(name: str, joints: Tensor, confidence: Tensor) -> list[Finding]:
    """Say so where joints go as far from one frame to the next as between any two frames.

    Args:
        name: of the view.
        joints: in an image or in space, (F, 16, D).
        confidence: (F, 16).
    """
    height = person_height(joints, confidence)
    seen = int((confidence > SURE).any(-1).sum())
    share = in_no_order(_way(joints, confidence), len(joints), height, seen)
    if share is None:
        return []
    what = (
        "frames look like images that do not follow one another: from each to the next joints go "
        f"{share:.0%} as far as between any two"
    )
    remedy = (
        "give successive frames of one clip; single images, as of a shuffled batch, are clips of "
        "one frame each (B, 1, C, ...), and joints that are noise alone look alike"
    )
    return [Finding(Severity.WARNING, name, what, remedy)]


def _way(joints: Tensor, confidence: Tensor) -> Way:
    """The median step of a joint from frame to frame, in their unit."""

    def way(order: Tensor) -> Steps:
        index = order.to(joints.device)
        sure = confidence[index] > SURE
        both = sure[1:] & sure[:-1]
        apart = joints[index].diff(dim=0).norm(dim=-1)
        steps = torch.where(both, apart, torch.nan).nanmedian(-1).values
        known = steps[steps.isfinite()]
        return Steps(float(known.mean()) if len(known) >= _PAIRS else float("nan"), len(known))

    return way
