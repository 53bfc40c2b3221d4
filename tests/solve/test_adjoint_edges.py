"""Gradients where a solve failed, was asked twice, or is not asked for any."""

from __future__ import annotations

import math

import pytest
import torch
from adjoint_problems import F64, QUICK, TIGHT, loss, problem, scalar
from block_toy import block_toy
from torch import Tensor
from toy import Frames

from perfcap.errors import InputError
from perfcap.solve import (
    Adam,
    Adjoint,
    Detached,
    GemanMcClure,
    Huber,
    Implicit,
    Kernel,
    LevenbergMarquardt,
    Objective,
    Residual,
    ResidualFunction,
    Sensitivity,
    Solution,
    Status,
    TruncatedNewton,
    Unrolled,
    Vector,
    solve,
)
from perfcap.solve.stationarity import kernel_bend


@pytest.mark.long
@pytest.mark.parametrize("adjoint", [Implicit(), Unrolled()])
def test_values_are_those_of_the_solve(adjoint: Adjoint) -> None:
    objective, state, bounds = problem()
    data = objective.energies["data"]
    data.target = data.target.clone().requires_grad_()
    plain = solve(objective, state, TIGHT, bounds)
    assert not plain.state.frame.requires_grad
    with torch.no_grad():
        assert not solve(objective, state, TIGHT, bounds, adjoint).state.frame.requires_grad
    solution = solve(objective, state, TIGHT, bounds, adjoint)
    assert solution.state.frame.requires_grad and not solution.energy.requires_grad
    torch.testing.assert_close(solution.state.frame.detach(), plain.state.frame)
    if isinstance(adjoint, Implicit):
        assert torch.equal(solution.state.frame.detach(), plain.state.frame)


@pytest.mark.parametrize("adjoint", [Implicit(), Unrolled(2)])
def test_a_second_backward_pass_needs_the_graph(adjoint: Adjoint) -> None:
    leaf = torch.tensor([1.0, 2.0], dtype=F64, requires_grad=True)

    def found() -> Tensor:
        start = Vector(torch.zeros(2, dtype=F64))
        return solve(scalar(leaf.sin()), start, TIGHT, None, adjoint).state.values.sum()

    once = found()
    once.backward()
    with pytest.raises(RuntimeError, match="second time"):
        once.backward()
    leaf.grad = None
    twice = found()
    twice.backward(retain_graph=True)
    first = leaf.grad.clone()
    twice.backward()
    torch.testing.assert_close(leaf.grad, 2 * first)


def test_a_solution_used_twice_sums_its_gradients() -> None:
    leaf = torch.tensor([1.0, 2.0], dtype=F64, requires_grad=True)
    start = Vector(torch.zeros(2, dtype=F64))
    found = solve(scalar(leaf), start, TIGHT, None, Implicit()).state.values
    (found.sum() + 3 * found.square().sum()).backward()
    torch.testing.assert_close(leaf.grad, 1 + 6 * leaf.detach())


@pytest.mark.parametrize("adjoint", [Implicit(), Implicit("gauss_newton"), Unrolled(2)])
@pytest.mark.parametrize("power", [1, 2])
def test_gradients_of_gradients_are_refused(adjoint: Adjoint, power: int) -> None:
    """Also of a linear loss, whose slope has no graph: it went through, and was wrong."""
    leaf = torch.tensor([1.0], dtype=F64, requires_grad=True)
    start = Vector(leaf.detach() * 0)
    found = solve(scalar(leaf.sin()), start, TIGHT, None, adjoint).state.values
    with pytest.raises(RuntimeError, match="create_graph=True was asked"):
        torch.autograd.grad((found**power).sum(), leaf, create_graph=True)


@pytest.mark.long
@pytest.mark.parametrize("adjoint", [Implicit(), Implicit("gauss_newton"), Unrolled(3)])
@pytest.mark.parametrize("spoiled", ["target", "confidence", "matrix"])
def test_failed_elements_get_zero_and_spoil_nothing(adjoint: Adjoint, spoiled: str) -> None:
    """NaN in one element: its gradient is zero, that of what it shares comes from the other."""
    objective, state, bounds = problem(GemanMcClure(0.5))
    data = objective.energies["data"]
    whole = {name: getattr(data, name).clone() for name in ("target", "confidence", "matrix")}

    def gradients(broken: bool) -> tuple[tuple[Tensor, ...], Solution]:
        leaves = {name: value.clone() for name, value in whole.items()}
        if broken:
            leaves[spoiled][1] = math.nan
        for name, value in leaves.items():
            setattr(data, name, value.requires_grad_())
        data.weight = torch.ones((), dtype=F64, requires_grad=True)
        solution = solve(objective, state, QUICK, bounds, adjoint)
        value = loss(Frames(solution.state.frame[:1], solution.state.shared[:1]))
        if broken:
            value = value + solution.state.frame[1].sum()
        return torch.autograd.grad(value, [data.weight, *leaves.values()]), solution

    plain, _ = gradients(broken=False)
    found, solution = gradients(broken=True)
    assert solution.status.tolist()[1] == Status.NOT_FINITE
    assert solution.sensitivity.tolist()[1] == Sensitivity.ZERO
    torch.testing.assert_close(found[0], plain[0])
    for own, expected in zip(found[1:], plain[1:], strict=True):
        torch.testing.assert_close(own[0], expected[0])
        assert not own[1].any()


class Twisted(ResidualFunction):
    """Says that its derivative is the opposite of what it is, so that no step succeeds."""

    def linearize(self, state):
        linear = super().linearize(state)
        return type(linear)(linear.residual, -linear.frame)


def test_stalled_solves_get_zero() -> None:
    leaf = torch.tensor([1.0], dtype=F64, requires_grad=True)
    objective = Objective(wrong=Twisted(lambda x: x - leaf))
    start = Vector(torch.zeros(1, dtype=F64))
    solution = solve(objective, start, LevenbergMarquardt(300), None, Implicit())
    assert solution.status == Status.STALLED
    assert solution.sensitivity == Sensitivity.ZERO
    assert float(torch.autograd.grad(solution.state.values.sum(), leaf)[0]) == 0


def test_unknowns_that_nothing_determines() -> None:
    """One of two unknowns is not seen: the other's gradient is what it would be alone."""
    leaf = torch.tensor([1.0], dtype=F64, requires_grad=True)
    objective = Objective(first=ResidualFunction(lambda x: x[..., :1] - leaf))
    start = Vector(torch.zeros(2, dtype=F64))
    solution = solve(objective, start, TIGHT, None, Implicit())
    assert solution.sensitivity == Sensitivity.DAMPED
    (gradient,) = torch.autograd.grad(solution.state.values.sum(), leaf)
    assert float(gradient) == pytest.approx(1, rel=1e-6)


def test_a_hessian_that_is_not_positive_gives_way() -> None:
    """At a maximum of a robust energy the full Hessian is negative."""
    leaf = torch.tensor([0.0], dtype=F64, requires_grad=True)
    residual = ResidualFunction(lambda x: x - leaf, kernel=GemanMcClure(0.1))
    start = Vector(torch.ones(1, dtype=F64))
    solution = solve(Objective(far=residual), start, LevenbergMarquardt(0), None, Implicit())
    assert solution.sensitivity == Sensitivity.GAUSS_NEWTON
    assert torch.autograd.grad(solution.state.values.sum(), leaf)[0].isfinite().all()


def test_damping_shortens_gradients() -> None:
    leaf = torch.tensor([1.0], dtype=F64, requires_grad=True)
    start = Vector(torch.zeros(1, dtype=F64))
    found = solve(scalar(leaf), start, TIGHT, None, Implicit(damping=1.0)).state.values
    (gradient,) = torch.autograd.grad(found.sum(), leaf)
    assert 0.4 < float(gradient) < 0.51


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_autocast_does_not_reach_the_solve(dtype: torch.dtype) -> None:
    leaf = torch.tensor([1.0, 2.0], dtype=dtype, requires_grad=True)
    matrix = torch.tensor([[1.0, 0.1], [0.2, 1.0]], dtype=dtype)
    objective = Objective(near=ResidualFunction(lambda x: x @ matrix - leaf))
    start = Vector(torch.zeros(2, dtype=dtype))
    plain = solve(objective, start, TIGHT, None, Implicit()).state.values
    (expected,) = torch.autograd.grad(plain.sum(), leaf)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = solve(objective, start, TIGHT, None, Implicit()).state.values
    (gradient,) = torch.autograd.grad(found.sum(), leaf)  # outside, as torch wants it
    assert torch.equal(found, plain)
    assert torch.equal(gradient, expected)


@pytest.mark.parametrize("kernel", [GemanMcClure(0.7), Huber(0.7)])
def test_bend_of_kernels(kernel: Kernel) -> None:
    squared = torch.linspace(0.01, 3, 50, dtype=F64)
    bend = kernel_bend(kernel, squared)
    assert bend is not None
    numeric = (kernel.slope(squared + 1e-6) - kernel.slope(squared - 1e-6)) / 2e-6
    torch.testing.assert_close(bend, numeric, rtol=1e-6, atol=1e-8)


def test_bad_settings_are_named() -> None:
    objective, state, bounds = problem()
    with pytest.raises(InputError, match="expected 'full', 'gauss_newton' or 'products'"):
        Implicit("newton")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="damping is nan"):
        Implicit(damping=math.nan)
    with pytest.raises(InputError, match="steps is 0"):
        Unrolled(0)
    with pytest.raises(InputError, match="expected LevenbergMarquardt"):
        solve(objective, state, Adam(), bounds, Unrolled())


def test_frames_solved_on_their_own_are_refused() -> None:
    objective, state = block_toy()
    with pytest.raises(InputError, match="solves frames on their own"):
        solve(objective, state, TruncatedNewton(), None, Implicit())


class Watched(ResidualFunction):
    """Counts how often its residual is asked for."""

    calls = 0

    def residual(self, state) -> Residual:
        type(self).calls += 1
        return super().residual(state)


def test_detached_costs_nothing() -> None:
    objective = Objective(near=Watched(lambda x: x - 1.0))
    start = Vector(torch.zeros(1, dtype=F64))
    solve(objective, start, TIGHT)
    calls, Watched.calls = Watched.calls, 0
    solve(objective, start, TIGHT, None, Detached())
    assert Watched.calls == calls
