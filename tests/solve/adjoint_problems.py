"""Small bounded problems, and slopes of their solutions."""

from __future__ import annotations

import torch
from polish import minimum
from torch import Tensor
from toy import Frames, toy

from perfcap.solve import (
    Adjoint,
    Bounds,
    Kernel,
    LevenbergMarquardt,
    Objective,
    ResidualFunction,
    solve,
)

F64 = torch.float64
TIGHT = LevenbergMarquardt(100, 1e-13)
QUICK = LevenbergMarquardt(40, 1e-9)


def normal(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


def problem(kernel: Kernel | None = None, shared: int = 0, batch: tuple[int, ...] = (2,)):
    """A toy in a box that some of its coordinates press against."""
    objective, state = toy(batch=batch, frames=4, shared=shared, windows=2, kernel=kernel)
    with torch.no_grad():
        values = solve(objective, state, TIGHT).state.frame.flatten()
    low, high = (torch.quantile(values, share).expand(4) for share in (0.2, 0.8))
    return objective, state, Bounds.on_frames(low, high)


def loss(state: Frames) -> Tensor:
    frame = (state.frame * normal(*state.frame.shape, seed=1)).sum()
    return frame + (state.shared * normal(*state.shared.shape, seed=2)).sum()


def slope(
    objective: Objective,
    state: Frames,
    bounds: Bounds | None,
    adjoint: Adjoint,
    method: LevenbergMarquardt = TIGHT,
):
    """Gradient of the loss in the targets, and the solution."""
    data = objective.energies["data"]
    leaf = data.target.detach().clone().requires_grad_()
    data.target = leaf
    solution = solve(objective, state, method, bounds, adjoint)
    data.target = leaf.detach()
    return torch.autograd.grad(loss(solution.state), leaf)[0], solution


def difference(objective: Objective, state: Frames, bounds: Bounds | None, move: Tensor) -> float:
    data, values, size = objective.energies["data"], [], 1e-4
    start = minimum(objective, state, bounds)
    target = data.target
    for sign in (1, -1):
        data.target = target + sign * size * move
        values.append(loss(minimum(objective, start, bounds)))
    data.target = target
    return float((values[0] - values[1]) / (2 * size))


def scalar(target: Tensor, weight: float | Tensor = 1.0) -> Objective:
    return Objective(near=ResidualFunction(lambda x: x - target, weight))
