"""Gradients of solutions: exact, and the same for batches and loops."""

from __future__ import annotations

import math

import pytest
import torch
from adjoint_problems import F64, QUICK, TIGHT, difference, normal, problem, scalar, slope
from torch import Tensor, nn
from toy import Frames

from perfcap.solve import (
    Adam,
    Adjoint,
    Bounds,
    Detached,
    GemanMcClure,
    Huber,
    Implicit,
    Kernel,
    LevenbergMarquardt,
    Objective,
    ResidualFunction,
    Sensitivity,
    Step,
    Unrolled,
    Vector,
    solve,
)

KERNELS: dict[str, Kernel | None] = {
    "quadratic": None,
    "Geman-McClure": GemanMcClure(0.5),
    "Huber": Huber(0.4),
}


@pytest.mark.long
@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("shared", [0, 2])
def test_full_hessian_agrees_with_differences(name: str, shared: int) -> None:
    objective, state, bounds = problem(KERNELS[name], shared)
    gradient, solution = slope(objective, state, bounds, Implicit())
    assert (solution.sensitivity == Sensitivity.EXACT).all()
    on_bounds = (solution.state.frame == bounds.lower.frame) | (
        solution.state.frame == bounds.upper.frame
    )
    assert on_bounds.sum() >= 4
    move = normal(*gradient.shape, seed=3)
    expected = difference(objective, state, bounds, move)
    assert float((gradient * move).sum()) == pytest.approx(expected, rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(("name", "shared"), [("quadratic", 0), ("Geman-McClure", 2)])
def test_all_steps_unrolled_agree_with_the_minimum(name: str, shared: int) -> None:
    objective, state, bounds = problem(KERNELS[name], shared)
    exact, _ = slope(objective, state, bounds, Implicit())
    errors = []
    for steps in (1, 6, None):
        unrolled, solution = slope(objective, state, bounds, Unrolled(steps))
        assert (solution.sensitivity == Sensitivity.UNROLLED).all()
        errors.append(float((unrolled - exact).norm() / exact.norm()))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-4


def test_one_undamped_step_is_gauss_newton() -> None:
    objective, state, bounds = problem()
    one, _ = slope(objective, state, bounds, Unrolled(1))
    approximate, solution = slope(objective, state, bounds, Implicit("gauss_newton"))
    assert (solution.sensitivity == Sensitivity.GAUSS_NEWTON).all()
    torch.testing.assert_close(one, approximate, rtol=1e-2, atol=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("adjoint", [Implicit(), Implicit("gauss_newton"), Unrolled(3)])
def test_batch_equals_loop(adjoint: Adjoint) -> None:
    objective, state, bounds = problem(GemanMcClure(0.5), shared=2)
    data = objective.energies["data"]
    together, _ = slope(objective, state, bounds, adjoint, QUICK)
    coefficients = normal(*state.frame.shape, seed=1), normal(*state.shared.shape, seed=2)
    whole = data.matrix, data.target, data.confidence
    for index in range(2):
        data.matrix, data.confidence = whole[0][index], whole[2][index]
        leaf = data.target = whole[1][index].clone().requires_grad_()
        alone = Frames(state.frame[index], state.shared[index])
        found = solve(objective, alone, QUICK, bounds, adjoint).state
        own = (found.frame * coefficients[0][index]).sum()
        own = own + (found.shared * coefficients[1][index]).sum()
        (gradient,) = torch.autograd.grad(own, leaf)
        torch.testing.assert_close(gradient, together[index], rtol=1e-6, atol=1e-9)


def test_coordinates_on_their_bounds_do_not_move() -> None:
    objective, state, bounds = problem()
    data = objective.energies["data"]
    data.target = data.target.clone().requires_grad_()
    found = solve(objective, state, TIGHT, bounds, Implicit()).state.frame
    pressed = ((found == bounds.lower.frame) | (found == bounds.upper.frame)).nonzero()
    for place in pressed[:3].tolist():
        (gradient,) = torch.autograd.grad(found[tuple(place)], data.target, retain_graph=True)
        assert not gradient.any()
    assert torch.autograd.grad(found.sum(), data.target)[0].any()


def half_line() -> Bounds:
    """From zero on."""
    zero, none = torch.zeros(1, dtype=F64), torch.zeros(0, dtype=F64)
    return Bounds(Step(zero, none), Step(zero + math.inf, none))


@pytest.mark.parametrize(("target", "expected"), [(0.5, 1.0), (-0.5, 0.0), (0.0, 1.0)])
def test_degenerate_bounds_count_as_free(target: float, expected: float) -> None:
    leaf = torch.tensor([target], dtype=F64, requires_grad=True)
    start = Vector(torch.ones(1, dtype=F64))
    found = solve(scalar(leaf), start, TIGHT, half_line(), Implicit()).state.values
    assert float(torch.autograd.grad(found.sum(), leaf)[0]) == pytest.approx(expected)


@pytest.mark.long
def test_gradcheck() -> None:
    """A curved residual, so that Gauss-Newton's matrix is not the Hessian."""

    def solution(target: Tensor, weight: Tensor) -> Tensor:
        def curved(x: Tensor) -> Tensor:
            first = x[..., :1] + 0.3 * x[..., 1:].square() - target[..., :1]
            return torch.cat((first, x.sin() - target), -1)

        objective = Objective(
            curve=ResidualFunction(curved, weight),
            rest=ResidualFunction(lambda x: 0.5 * x, kernel=GemanMcClure(2.0)),
        )
        start = Vector(torch.zeros(2, dtype=F64))
        adjoint = Implicit() if torch.is_grad_enabled() else Detached()
        return solve(objective, start, LevenbergMarquardt(200, 1e-16), None, adjoint).state.values

    target = torch.tensor([0.4, 0.9], dtype=F64, requires_grad=True)
    weight = torch.tensor(1.3, dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(solution, (target, weight), eps=1e-4, atol=1e-6, rtol=1e-4)


def test_other_methods_are_differentiated_at_what_they_find() -> None:
    leaf = torch.tensor([0.5, 2.0], dtype=F64, requires_grad=True)
    start = Vector(torch.zeros(2, dtype=F64))
    found = solve(scalar(leaf), start, Adam(400), None, Implicit()).state.values
    torch.testing.assert_close(
        torch.autograd.functional.jacobian(lambda t: t, leaf.detach()),
        torch.stack([torch.autograd.grad(x, leaf, retain_graph=True)[0] for x in found]),
    )


def test_weights_may_be_learned() -> None:
    weight = nn.Parameter(torch.tensor(2.0, dtype=F64))
    one, four = torch.tensor([1.0], dtype=F64), torch.tensor([4.0], dtype=F64)
    objective = Objective(
        low=ResidualFunction(lambda x: x - one),
        high=ResidualFunction(lambda x: x - four, weight),
    )
    found = solve(objective, Vector(torch.zeros(1, dtype=F64)), TIGHT, None, Implicit())
    found.state.values.sum().backward()
    # x = (1 + 4 w) / (1 + w)
    assert float(weight.grad) == pytest.approx(3 / 9)


def test_nothing_to_differentiate_gives_a_constant() -> None:
    objective, state, bounds = problem()
    for adjoint in (None, Detached(), Implicit()):
        solution = solve(objective, state, TIGHT, bounds, adjoint)
        assert not solution.state.frame.requires_grad
        assert solution.sensitivity is None
