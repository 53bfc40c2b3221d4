"""Coarse corrections in torch: for GPUs, and what the kernels must equal."""

from __future__ import annotations

import torch
from torch import Tensor


def correct(
    group: Tensor, modes: Tensor, inverse: Tensor, residual: Tensor, image: Tensor, running: Tensor
) -> None:
    """See ``coarse.CoarseCorrection.add``."""
    member, group = (group >= 0)[:, None], group.clamp(min=0)
    pull = (modes.mT @ residual.unsqueeze(-1)).squeeze(-1)  # P M r
    count = pull.shape[-1]
    sums = pull.new_zeros(len(pull), inverse.shape[-1] // count, count)
    sums.index_add_(1, group, torch.where(member, pull, 0))
    moved = (inverse @ sums.flatten(1).unsqueeze(-1)).view_as(sums)
    back = (modes @ moved[:, group].unsqueeze(-1)).squeeze(-1)
    image.add_(torch.where(member & running[:, None, None], back, 0))


def add_outer(matrix: Tensor, groups: Tensor, rows: Tensor, weight: Tensor) -> None:
    """Add ``weight rows' rows`` to the lower triangle of coarse matrices.

    Args:
        matrix: (P, C, r, C, r); diagonal blocks are whole.
        groups: which group a row's slot belongs to, -1 for none, (P, G, k).
        rows: derivative of each group of residuals in the modes, slot by slot, (P, G, k, d, r).
        weight: (P, G).
    """
    problems, coarse, count = matrix.shape[:3]
    weighted = weight[..., None, None, None] * rows
    blocks = torch.einsum("pgadm,pgbdn->pgabmn", weighted, rows)
    a, b = groups.unsqueeze(-1), groups.unsqueeze(-2)
    kept = (a >= b) & (b >= 0)
    first = torch.arange(problems, device=matrix.device)[:, None, None, None] * coarse**2
    place = torch.where(kept, first + a * coarse + b, first)
    sums = matrix.new_zeros(problems * coarse**2, count, count)
    sums.index_add_(0, place.flatten(), torch.where(kept[..., None, None], blocks, 0).flatten(0, 3))
    matrix += sums.view(problems, coarse, coarse, count, count).transpose(2, 3)
