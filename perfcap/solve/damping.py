"""Levenberg-Marquardt damping: its scale, and its update by the gain ratio."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.solve.normal_equations import NormalEquations

GROWTH, LEAST = 4.0, 1e-16
_FLOOR = 1e-2  # of an unknown's mean data curvature, in frames that see it poorly


def damping_scale(equations: NormalEquations) -> Tensor:
    """What a damping of one adds to the diagonal, (B, N): the curvature of the data alone.

    A smoothness prior is a thousand to a million times stiffer than the data; damping by the full
    diagonal (Marquardt 1963) would hold the data still. Every unknown is damped in its own unit:
    in frames that see it poorly by a share of its mean over the frames, and where no frame sees
    it, by a rounding unit of the window energies' curvature. Zero where nothing sees it at all.
    """
    frame, shared = equations.data_diagonal()
    mean = frame.mean(1, keepdim=True)
    floor = _FLOOR * mean
    if equations.windows:
        squares = [window.jacobian.square().mean((1, 2)) for window in equations.windows]
        floor = floor + torch.finfo(frame.dtype).eps * torch.stack(squares).sum(0).unsqueeze(1)
    return equations.join(frame + floor, shared)


def added_damping(value: Tensor, scale: Tensor) -> Tensor:
    """What is added to the diagonal, (B, N), for dampings (B,) and the scale of the unknowns.

    An unknown that nothing has seen has no slope either and stays where it is: any number will do.
    """
    return value.unsqueeze(-1) * torch.where(scale > 0, scale, 1)


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
        return cls(torch.full_like(like, value), torch.full_like(like, GROWTH))

    def update(self, tried: Tensor, accepted: Tensor, gain: Tensor) -> Damping:
        """Damping after steps that were tried and accepted or not, with gain ratios, (B,)."""
        fall = (1 - (2 * gain - 1) ** 3).clamp(min=1 / 3, max=2.0)
        value = torch.where(
            accepted, (self.value * fall).clamp(min=LEAST), self.value * self.growth
        )
        growth = torch.where(accepted, GROWTH, 2 * self.growth)
        return Damping(
            torch.where(tried, value, self.value), torch.where(tried, growth, self.growth)
        )
