"""What a damping of one adds to the diagonal of the normal equations."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.solve.normal_equations import NormalEquations

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
