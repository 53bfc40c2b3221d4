"""Frames in which a joint leaps there and back, as no limb does."""

from __future__ import annotations

import torch
from torch import Tensor

LEAP = 0.2  # m from the middle of the places in the frames before and after
# Share of the frames of a motion: the six people of the CMU library are far below it, without clips
# that are marked as glitches
LEAPING = 0.005


def leaping(joints: Tensor) -> Tensor:
    """Whether a joint is ``LEAP`` or more from the middle of where it is before and after.

    Args:
        joints: (F, J, 3), metres.

    Returns:
        (F,), bool; False in the first frame and the last.
    """
    found = torch.zeros(len(joints), dtype=torch.bool, device=joints.device)
    if len(joints) > 2:
        away = joints[1:-1] - 0.5 * (joints[2:] + joints[:-2])
        found[1:-1] = away.norm(dim=-1).amax(-1) > LEAP
    return found
