"""Batched nonnegative quadratic programs: the multipliers of a box-constrained step.

    minimize  1/2 x' K x - c' x   subject to  x >= 0,   K symmetric positive definite.

Active-set method of Lawson and Hanson (1974, chapter 23), with two changes: it starts from any
guess of the support, and every entry whose slope asks for it enters at once. Entries that enter
and do not want to be positive leave again, and at least one always stays (the slope along the
step is the sum of theirs); the objective then falls strictly, so no support returns and the
method ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.solve.products import apply


@dataclass(frozen=True)
class NonnegativeProgram:
    """A batch of programs of the same size.

    Args:
        matrix: K, (B, m, m).
        target: c, (B, m).
        usable: entries that exist; the others are padding and stay zero, (B, m).
        tolerance: gradients up to this count as zero, (B, 1).
    """

    matrix: Tensor
    target: Tensor
    usable: Tensor
    tolerance: Tensor

    def solve(self, support: Tensor, rounds: int) -> tuple[Tensor, Tensor]:
        """Minimisers (B, m) from a guess of their support, and whether each was reached (B,)."""
        support = support & self.usable
        value = torch.zeros_like(self.target)
        done = torch.zeros_like(self.target[:, 0], dtype=torch.bool)
        for _ in range(rounds):
            best = self._minimum_on(support)
            negative = support & (best <= 0)
            unwanted = negative & (value <= 0)
            # asked for together, as a graphics card has to be waited for
            drop, stop = torch.stack((unwanted.any(), negative.any())).tolist()
            if drop:
                support = support & ~unwanted
                continue
            whole = ~negative.any(-1, keepdim=True)
            if stop:
                value, support = _step_towards(best, value, support, negative)
            else:
                value = best
            slope = self.target - apply(self.matrix, value)
            entering = self.usable & ~support & (slope > self.tolerance) & whole
            done = whole.squeeze(-1) & ~entering.any(-1)
            if bool(done.all()):
                break
            support = support | entering
        return value, done

    def _minimum_on(self, support: Tensor) -> Tensor:
        """Minimum of the quadratic over the entries of the support, zero elsewhere."""
        index, real = pack(support)
        batch = torch.arange(len(index), device=index.device)[:, None]
        matrix = self.matrix[batch.unsqueeze(-1), index.unsqueeze(-1), index.unsqueeze(-2)]
        right = self.target[batch, index]
        if len(index) > 1:  # padding: a row of the identity with nothing on the right
            identity = torch.eye(index.shape[-1], dtype=matrix.dtype, device=matrix.device)
            matrix = torch.where(real.unsqueeze(-1) & real.unsqueeze(-2), matrix, identity)
            right = torch.where(real, right, 0)
        root, _ = torch.linalg.cholesky_ex(matrix)
        values = torch.cholesky_solve(right.unsqueeze(-1), root).squeeze(-1)
        return torch.zeros_like(self.target).scatter_add(1, index, values)


def pack(mask: Tensor) -> tuple[Tensor, Tensor]:
    """Indices of the set entries of rows (B, n), padded to the longest row, and which are real."""
    if len(mask) == 1:
        index = mask.nonzero()[:, 1].unsqueeze(0)
        return index, torch.ones_like(index, dtype=torch.bool)
    length = int(mask.sum(-1).max())
    real, index = mask.to(torch.uint8).topk(length, dim=-1)
    return index, real.bool()


def _step_towards(
    best: Tensor, value: Tensor, support: Tensor, negative: Tensor
) -> tuple[Tensor, Tensor]:
    """Move to ``best`` or until an entry of the support reaches zero.

    Returns:
        The values, and the support without entries that reached zero.
    """
    whole = ~negative.any(-1, keepdim=True)
    ratio = torch.where(negative, value / (value - best), torch.inf)
    length = ratio.amin(-1, keepdim=True)
    support = support & ~(negative & (ratio <= length))
    moved = torch.where(whole, best, value + length.clamp(max=1) * (best - value))
    return torch.where(support, moved, 0), support
