"""Gradients of solutions: exact, the same for batches and loops, zero where a solve failed."""

from __future__ import annotations

import math

import pytest
import torch
from block_toy import block_toy
from polish import minimum
from torch import Tensor, nn
from toy import Frames, toy

from perfcap.errors import InputError
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
    Residual,
    ResidualFunction,
    Sensitivity,
    Solution,
    Status,
    Step,
    TruncatedNewton,
    Unrolled,
    Vector,
    solve,
)
from perfcap.solve.stationarity import kernel_bend

F64 = torch.float64
TIGHT = LevenbergMarquardt(100, 1e-13)
QUICK = LevenbergMarquardt(40, 1e-9)
KERNELS: dict[str, Kernel | None] = {
    "quadratic": None,
    "Geman-McClure": GemanMcClure(0.5),
    "Huber": Huber(0.4),
}


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


def scalar(target: Tensor, weight: float | Tensor = 1.0) -> Objective:
    return Objective(near=ResidualFunction(lambda x: x - target, weight))


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


def test_gradients_of_gradients_are_refused() -> None:
    leaf = torch.tensor([1.0], dtype=F64, requires_grad=True)
    found = solve(scalar(leaf), Vector(leaf.detach() * 0), TIGHT, None, Implicit()).state.values
    (gradient,) = torch.autograd.grad(found.square().sum(), leaf, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()


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
    with pytest.raises(InputError, match="expected 'full' or 'gauss_newton'"):
        Implicit("newton")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="damping from 0 on"):
        Implicit(damping=math.nan)
    with pytest.raises(InputError, match="at least 1"):
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
