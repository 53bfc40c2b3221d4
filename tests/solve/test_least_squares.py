"""Textbook problems crossed with solvers, and scipy as an oracle for bounded ones.

Problems and minima: Moré, Garbow and Hillstrom, Testing Unconstrained Optimization Software, 1981.
The energy is the sum of squares.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
import torch
from scipy.optimize import least_squares
from torch import Tensor

from perfcap.solve import (
    Bounds,
    LevenbergMarquardt,
    Objective,
    ResidualFunction,
    Status,
    Vector,
    solve,
)


@dataclass(frozen=True)
class Problem:
    function: Callable[[Tensor], Tensor]
    start: tuple[float, ...]
    minimum: float
    lower: tuple[float, ...] | None = None
    upper: tuple[float, ...] | None = None

    def objective(self) -> Objective:
        return Objective(sum=ResidualFunction(self.function))

    def initial(self) -> Vector:
        return Vector(torch.tensor(self.start, dtype=torch.float64))

    def bounds(self) -> Bounds | None:
        if self.lower is None:
            return None
        lower = torch.tensor(self.lower, dtype=torch.float64)
        return Bounds.on_frames(lower, torch.tensor(self.upper, dtype=torch.float64))


def _rosenbrock(x):
    return torch.stack((10 * (x[..., 1] - x[..., 0] ** 2), 1 - x[..., 0]), -1)


def _powell_singular(x):
    a, b, c, d = x.unbind(-1)
    return torch.stack((a + 10 * b, 5**0.5 * (c - d), (b - 2 * c) ** 2, 10**0.5 * (a - d) ** 2), -1)


def _freudenstein_roth(x):
    a, b = x.unbind(-1)
    return torch.stack((-13 + a + ((5 - b) * b - 2) * b, -29 + a + ((b + 1) * b - 14) * b), -1)


def _box3d(x):
    t = 0.1 * torch.arange(1, 11, dtype=x.dtype)
    a, b, c = x.unsqueeze(-2).unbind(-1)
    return torch.exp(-t * a) - torch.exp(-t * b) - c * (torch.exp(-t) - torch.exp(-10 * t))


def _kowalik_osborne(x):
    y = [0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246]
    u = [4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625]
    y, u = torch.tensor(y, dtype=x.dtype), torch.tensor(u, dtype=x.dtype)
    a, b, c, d = x.unsqueeze(-2).unbind(-1)
    return y - a * (u**2 + u * b) / (u**2 + u * c + d)


def _beale(x):
    a, b = x.unsqueeze(-2).unbind(-1)
    power = torch.arange(1, 4, dtype=x.dtype)
    return torch.tensor([1.5, 2.25, 2.625], dtype=x.dtype) - a * (1 - b**power)


def _helical_valley(x):
    a, b, c = x.unbind(-1)
    turn = torch.atan2(b, a) / (2 * torch.pi)
    return torch.stack((10 * (c - 10 * turn), 10 * (torch.hypot(a, b) - 1), c), -1)


def _bard(x):
    y = [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39]
    u = torch.arange(1, 16, dtype=x.dtype)
    v = 16 - u
    a, b, c = x.unsqueeze(-2).unbind(-1)
    return torch.tensor(y, dtype=x.dtype) - (a + u / (v * b + torch.minimum(u, v) * c))


def _brown_badly_scaled(x):
    a, b = x.unbind(-1)
    return torch.stack((a - 1e6, b - 2e-6, a * b - 2), -1)


PROBLEMS = {
    "rosenbrock": Problem(_rosenbrock, (-1.2, 1.0), 0.0),
    "powell singular": Problem(_powell_singular, (3.0, -1.0, 0.0, 1.0), 0.0),
    "freudenstein-roth": Problem(_freudenstein_roth, (0.5, -2.0), 48.98425367924),
    "box3d": Problem(_box3d, (0.0, 10.0, 20.0), 0.0),
    "kowalik-osborne": Problem(_kowalik_osborne, (0.25, 0.39, 0.415, 0.39), 3.075056038492e-4),
    "helical valley": Problem(_helical_valley, (-1.0, 0.0, 0.0), 0.0),
    "bard": Problem(_bard, (1.0, 1.0, 1.0), 8.214877306578e-3),
    "beale": Problem(_beale, (1.0, 1.0), 0.0),
    "beale on its bound": Problem(_beale, (1.0, 1.0), 0.0, (0.6, 0.5), (10.0, 100.0)),
    "rosenbrock bounded": Problem(_rosenbrock, (-1.2, 1.0), 0.25, (-2.0, -2.0), (0.5, 2.0)),
    "brown badly scaled": Problem(_brown_badly_scaled, (1.0, 1.0), 0.0),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_textbook_minimum(name):
    problem = PROBLEMS[name]
    method = LevenbergMarquardt(max_steps=200, tolerance=1e-12)
    solution = solve(problem.objective(), problem.initial(), method, problem.bounds())
    assert solution.status == Status.CONVERGED
    # rounding is relative to where a problem starts: Brown's at 1e12
    start = problem.objective()(problem.initial()).item()
    near = max(1e-14, 1e-24 * start)
    assert solution.energy.item() == pytest.approx(problem.minimum, rel=1e-8, abs=near)


@pytest.mark.parametrize("seed", range(12))
def test_scipy_finds_the_same_bounded_minimum(seed):
    random = torch.Generator().manual_seed(seed)
    size, rows = 2 + seed % 5, 12
    matrix = torch.randn(rows, size, generator=random, dtype=torch.float64)
    target = torch.randn(rows, generator=random, dtype=torch.float64)
    lower = -0.1 - 0.5 * torch.rand(size, generator=random, dtype=torch.float64)
    upper = 0.05 + 0.3 * torch.rand(size, generator=random, dtype=torch.float64)
    lower[0], upper[-1] = -torch.inf, torch.inf

    def function(x):
        return (matrix @ x.unsqueeze(-1)).squeeze(-1) + 0.1 * x.square().sum(-1, True) - target

    solution = solve(
        Objective(sum=ResidualFunction(function)),
        Vector(torch.zeros(size, dtype=torch.float64)),
        LevenbergMarquardt(max_steps=100, tolerance=1e-13),
        Bounds.on_frames(lower, upper),
    )
    oracle = least_squares(
        lambda x: function(torch.tensor(x)).numpy(),
        torch.zeros(size).numpy(),
        bounds=(lower.numpy(), upper.numpy()),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-12,
    )
    assert solution.energy.item() <= 2 * oracle.cost * (1 + 1e-9)
    torch.testing.assert_close(solution.state.values, torch.tensor(oracle.x), rtol=1e-5, atol=1e-6)
    assert ((solution.state.values >= lower) & (solution.state.values <= upper)).all()
