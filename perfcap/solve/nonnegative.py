"""Batched nonnegative quadratic programs: the multipliers of a box-constrained step.

    minimize  1/2 x' K x - c' x   subject to  x >= 0,   K symmetric positive definite.

Active-set method of Lawson and Hanson (1974, chapter 23), with two changes: it starts from any
guess of the support, and several entries may enter at a time, one from each group.
Entries that enter and do not want to be positive leave at once, and at least one always stays
(the gradient along the step is the sum of theirs); the objective then falls strictly, so no
support returns and the method ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class NonnegativeProgram:
    """A batch of programs of the same size.

    Args:
        matrix: K, (B, m, m).
        target: c, (B, m).
        usable: entries that exist; the others are padding and stay zero, (B, m).
        group: nonnegative group number of each entry; weakly coupled entries belong to different
            groups, (B, m).
        tolerance: gradients up to this count as zero, (B, 1).
    """

    matrix: Tensor
    target: Tensor
    usable: Tensor
    group: Tensor
    tolerance: Tensor

    def solve(self, support: Tensor, rounds: int) -> tuple[Tensor, Tensor]:
        """Minimisers (B, m) from a guess of their support, and whether each was reached (B,)."""
        support = support & self.usable
        value = torch.zeros_like(self.target)
        done = torch.zeros_like(self.target[:, 0], dtype=torch.bool)
        for _ in range(rounds):
            best = self._minimum_on(support)
            unwanted = support & (value <= 0) & (best <= 0)
            settled = ~unwanted.any(-1, keepdim=True)
            value, support, whole = _step_towards(best, value, support & ~unwanted, settled)
            slope = self.target - (self.matrix @ value.unsqueeze(-1)).squeeze(-1)
            entering = self.usable & ~support & (slope > self.tolerance) & whole
            done = whole.squeeze(-1) & ~entering.any(-1)
            if bool(done.all()):
                break
            support = support | self._steepest(entering, slope)
        return value, done

    def _minimum_on(self, support: Tensor) -> Tensor:
        """Minimum of the quadratic over the entries of the support, zero elsewhere."""
        identity = torch.eye(support.shape[-1], dtype=torch.bool, device=support.device)
        both = support.unsqueeze(-1) & support.unsqueeze(-2)
        matrix = torch.where(both, self.matrix, identity.to(self.matrix.dtype))
        root, _ = torch.linalg.cholesky_ex(matrix)
        right = torch.where(support, self.target, 0).unsqueeze(-1)
        return torch.cholesky_solve(right, root).squeeze(-1)

    def _steepest(self, entering: Tensor, slope: Tensor) -> Tensor:
        """Of the entering entries, the steepest of each group."""
        slope = torch.where(entering, slope, 0)
        groups = slope.new_zeros(len(slope), int(self.group.max()) + 1)
        steepest = groups.scatter_reduce(1, self.group, slope, "amax")
        return entering & (slope >= steepest.gather(1, self.group))


def _step_towards(
    best: Tensor, value: Tensor, support: Tensor, settled: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Move settled elements to ``best`` or until an entry of the support reaches zero.

    Returns:
        The values, the support without entries that reached zero, and whether the whole step was
        taken (B, 1).
    """
    shrinking = support & (best <= 0)
    ratio = torch.where(shrinking, value / (value - best).clamp(min=1e-300), torch.inf)
    length = ratio.amin(-1, keepdim=True)
    whole = settled & (length >= 1)
    reached = settled & shrinking & (ratio <= length)
    moved = torch.where(whole, best, value + length.clamp(max=1) * (best - value))
    value = torch.where(settled, moved, value)
    value = torch.where(support & ~reached, value, 0)
    return value, support & ~reached, whole
