"""Where joints are going, and where they come from."""

from __future__ import annotations

import torch
from torch import Tensor

WINDOW = 4
"""Frames that a line is laid through."""
_FEWEST = 3  # of them, that must be known


def meeting(places: Tensor, known: Tensor, other: list[int] | None = None) -> tuple[Tensor, Tensor]:
    """Lines through the frames before and after each moment between two, continued to it.

    Args:
        places: (F, ..., D).
        known: which of them count, (F, ...).
        other: of joints (F, J, D), the one that each may go on as instead, if that is nearer.

    Returns:
        How far the line that ends there is from the one that begins there, (F - 1, ...); and how
        far places lie from both lines, root mean squares added up. NaN where too few are known.
    """
    before, beside = (each[:-1] for each in _continued(places, known))
    after, along = (each.flip(0)[1:] for each in _continued(places.flip(0), known.flip(0)))
    apart = (before - after).norm(dim=-1)
    if other is not None:
        instead = (before - after[:, other]).norm(dim=-1)
        apart = torch.where(apart.isfinite(), torch.fmin(apart, instead), apart)
    return apart, beside + along


def peaks(height: Tensor, least: float) -> Tensor:
    """Which of (N,) are above a bound and the highest of those whose lines meet there, (N,)."""
    reach = 2 * WINDOW - 1
    best = torch.nn.functional.max_pool1d(height.nan_to_num(0.0)[None], reach, 1, reach // 2)[0]
    return (height > least) & (height == best)


def _continued(places: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Half a frame after each one, by the line through the last ones, (F, ..., D).

    And how far these lie from it, (F, ...). NaN of too few.
    """
    ahead = WINDOW - 1
    padded, sure = (
        torch.cat((part.new_zeros(ahead, *part.shape[1:]), part)).unfold(0, WINDOW, 1)
        for part in (places, known.to(places))
    )  # F ... D W, F ... W
    time = torch.arange(WINDOW).to(places) - WINDOW + 0.5
    total, first, second = ((sure * time**power).sum(-1, keepdim=True) for power in (0, 1, 2))
    padded = torch.where(sure.unsqueeze(-2) > 0, padded, 0)
    value, slope = padded.sum(-1), (padded * time).sum(-1)
    spread = total * second - first**2
    end, speed = (second * value - first * slope) / spread, (total * slope - first * value) / spread
    off = (padded - end[..., None] - speed[..., None] * time).norm(dim=-2) * sure
    beside = (off.square().sum(-1) / (total[..., 0] - 1)).sqrt()
    enough = total >= _FEWEST
    return torch.where(enough, end, torch.nan), torch.where(enough[..., 0], beside, torch.nan)
