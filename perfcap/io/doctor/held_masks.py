"""Whether pixels around masks hold back what is fitted to them."""

from __future__ import annotations

import torch
from torch import Tensor

_HELD = 0.2  # of what pixels within masks count for, or of all those beyond


def held_within(masks: Tensor, trust: Tensor) -> float | None:
    """What pixels outside count for, of what those within do, where that is too little to hold.

    Args:
        masks: (F, C, H, W), bool or from 0 to 1.
        trust: how much each pixel counts, of a shape that broadcasts to the masks.
    """
    found = masks.detach() > 0.5
    counted = trust.detach().to(found.device)
    within, around = ((counted * each).sum(dtype=torch.float64) for each in (found, ~found))
    if bool(around < _HELD * within.clamp(max=float((~found).sum()))):
        return float(around / within)
    return None
