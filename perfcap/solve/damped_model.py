"""What a damped step is found from, and what it is: for compiled loops and torch."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.solve.bounds import StepBox
from perfcap.solve.damped_loop import Proposal
from perfcap.solve.normal_equations import NormalEquations

# --- What a damping of one adds to the diagonal of the normal equations ---------------------------

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


# --- What a damped step is found from, and what it is: for compiled loops and torch ---------------

_NEGLIGIBLE = 4  # units in the last place of the unknowns


@dataclass(frozen=True)
class DampedModel:
    """A model and how it is damped.

    Args:
        equations: the model.
        value: damping of each element, B numbers.
        undamped: which elements try a step without damping to speak of, B flags.
        running: which elements go on, B flags.
        here: scale of the unknowns at the state, (B, N).
        scale: the largest so far, which a damping of one adds to the diagonal, (B, N).
        at: coordinates of the state, (B, N).
        box: bounds on the step, as seen from the state.
        multipliers: of the bounds in a similar problem, (B, N).
    """

    equations: NormalEquations
    value: list[float]
    undamped: list[bool]
    running: list[bool]
    here: Tensor
    scale: Tensor
    at: Tensor
    box: StepBox | None
    multipliers: Tensor

    def damping(self) -> Tensor:
        """What is added to the diagonal, (B, N): where an undamped step is tried, a share of what
        the unknowns show here, however much that has been elsewhere.
        """
        value, scale = self.scale.new_tensor(self.value), self.scale
        if any(self.undamped):
            undamped = torch.tensor(self.undamped, device=value.device).unsqueeze(-1)
            scale = torch.where(undamped & (self.here > 0), self.here, scale)
        return added_damping(value, scale)


@dataclass(frozen=True, kw_only=True)
class DampedStep(Proposal):
    """A step within the bounds.

    Args:
        damping: what was added to the diagonal, (B, N).
        multipliers: of the bounds that hold the step, (B, N).
    """

    damping: Tensor
    multipliers: Tensor


def negligible_share(dtype: torch.dtype) -> float:
    """Of the squared length of the coordinates: steps that are shorter are rounding."""
    return float((_NEGLIGIBLE * torch.finfo(dtype).eps) ** 2)
