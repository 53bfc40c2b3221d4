"""Bone lengths of people, by which they are known again."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS

_PAIRS = {
    "shoulders": (("l_shoulder", "r_shoulder"),),
    "hips": (("l_hip", "r_hip"),),
    "upper_arms": (("l_shoulder", "l_elbow"), ("r_shoulder", "r_elbow")),
    "forearms": (("l_elbow", "l_wrist"), ("r_elbow", "r_wrist")),
    "sides": (("l_shoulder", "l_hip"), ("r_shoulder", "r_hip")),
    "thighs": (("l_hip", "l_knee"), ("r_hip", "r_knee")),
    "shanks": (("l_knee", "l_ankle"), ("r_knee", "r_ankle")),
}
BONE_NAMES = tuple(_PAIRS)
"""What is measured, left and right together."""

_SHORT = 0.02  # m; nobody has shorter ones, and logarithms are taken


def bone_lengths(points: Tensor) -> Tensor:
    """Lengths (..., 7) m of the bones of landmarks (..., 16, 3), means of left and right."""
    lengths = []
    for pairs in _PAIRS.values():
        ends = [[LANDMARKS.index(joint) for joint in pair] for pair in pairs]
        each = [(points[..., a, :] - points[..., b, :]).norm(dim=-1) for a, b in ends]
        lengths.append(torch.stack(each, -1).nanmean(-1))
    return torch.stack(lengths, -1)


def tracked_bones(points: Tensor) -> Tensor:
    """Median lengths (..., 7) over the frames of landmarks (..., F, 16, 3); NaN where unknown."""
    return bone_lengths(points).nanmedian(-2).values


def bone_difference(one: Tensor, other: Tensor) -> Tensor:
    """Root-mean-square difference of log lengths (..., 7), over those that both have.

    Infinite where they have less than half of them in common.
    """
    squared = (one.clamp(min=_SHORT).log() - other.clamp(min=_SHORT).log()).square()
    common = squared.isfinite().sum(-1)
    rms = squared.nanmean(-1).sqrt()
    return torch.where(2 * common >= len(BONE_NAMES), rms, torch.inf)
