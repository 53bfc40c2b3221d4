"""Levenberg-Marquardt damping: its scale, and its update by the gain ratio."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.solve.normal_equations import NormalEquations

_GROWTH, _LEAST = 4.0, 1e-12
_FLOOR = 1e-2  # of the mean data curvature, for unknowns that data see poorly


def damping_scale(equations: NormalEquations) -> Tensor:
    """What a damping of one adds to the diagonal, (B, N): the curvature of the data alone.

    A smoothness prior is a thousand to a million times stiffer than the data; damping by the full
    diagonal (Marquardt 1963) would hold the data still. Unknowns that no data see get a small
    share of the mean, and where there are no data at all, of the window energies' curvature.
    """
    diagonal = equations.join(*equations.data_diagonal())
    floor = _FLOOR * diagonal.mean(-1, keepdim=True)
    if equations.windows:
        stacked = torch.stack([_mean_square(window.jacobian) for window in equations.windows])
        floor = floor + torch.finfo(diagonal.dtype).eps * stacked.sum(0).unsqueeze(-1)
    return diagonal + floor.clamp(min=torch.finfo(diagonal.dtype).tiny)


def _mean_square(jacobian: Tensor) -> Tensor:
    """Mean square of the entries (B, F, E, D) of each batch element, (B,)."""
    norm = torch.linalg.vector_norm(jacobian, dim=(-3, -2, -1))
    mean: Tensor = norm.square() / jacobian[0].numel()
    return mean


@dataclass(frozen=True)
class Damping:
    """Damping of each batch element, (B,), and the factor its next increase takes.

    Update of Nielsen (1999), quicker to rise: a step as good as promised lets it fall to a third,
    a poor one raises it up to twofold, rejected steps raise it by 4, 8, 16, ... times.
    """

    value: Tensor
    growth: Tensor

    @classmethod
    def start(cls, value: float, like: Tensor) -> Damping:
        """The same damping for every element of ``like`` (B,)."""
        return cls(torch.full_like(like, value), torch.full_like(like, _GROWTH))

    def update(self, tried: Tensor, accepted: Tensor, gain: Tensor) -> Damping:
        """Damping after steps that were tried and accepted or not, with gain ratios, (B,)."""
        fall = (1 - (2 * gain - 1) ** 3).clamp(min=1 / 3, max=2.0)
        value = torch.where(
            accepted, (self.value * fall).clamp(min=_LEAST), self.value * self.growth
        )
        growth = torch.where(accepted, _GROWTH, 2 * self.growth)
        return Damping(
            torch.where(tried, value, self.value), torch.where(tried, growth, self.growth)
        )
