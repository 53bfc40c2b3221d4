"""Recovery, robustness and batches of the damped method on windows."""

from __future__ import annotations

import pytest
import torch
from toy import Frames, Observation, cosine_basis, toy

from perfcap.errors import InputError
from perfcap.solve import (
    Adam,
    Bounds,
    Energy,
    GemanMcClure,
    LevenbergMarquardt,
    Objective,
    Residual,
    Status,
    Step,
    Vector,
    solve,
)
from perfcap.solve.assembly import assemble

STRICT = LevenbergMarquardt(max_steps=200, tolerance=1e-13)
KINDS = {
    "frames only": {"windows": 0, "groups": 6},
    "window": {"windows": 1, "frames": 12},
    "stiff window": {"windows": 1, "frames": 12, "data": 1e-3},
    "shared": {"windows": 2, "shared": 2, "groups": 5},
    "robust": {"windows": 1, "kernel": GemanMcClure(1.0)},
}


def box(state):
    lower = torch.full((state.frame_dim,), -0.2, dtype=torch.float64)
    upper = torch.full((state.frame_dim,), 0.15, dtype=torch.float64)
    upper[1] = torch.inf
    shared = torch.full((state.shared.shape[-1],), 0.05, dtype=torch.float64)
    return Bounds(Step(lower, -torch.inf * shared), Step(upper, shared))


@pytest.mark.parametrize("kind", KINDS)
def test_minimum_is_stationary(kind):
    objective, state = toy(**KINDS[kind])
    solution = solve(objective, state, STRICT)
    assert solution.status == Status.CONVERGED, solution.describe()
    gradient = assemble(objective, solution.state).gradient()
    assert gradient.abs().max() < 1e-5 * assemble(objective, state).gradient().abs().max()
    assert solution.energy < objective(state)
    assert solution.energy == pytest.approx(objective(solution.state).item(), rel=1e-12)
    assert solution.energy == pytest.approx(sum(t.item() for t in solution.terms.values()))


@pytest.mark.parametrize("kind", KINDS)
def test_bounded_minimum_is_stationary_where_it_is_free(kind):
    objective, state = toy(**KINDS[kind])
    bounds = box(state)
    solution = solve(objective, state, STRICT, bounds)
    assert solution.status == Status.CONVERGED, solution.describe()
    equations = assemble(objective, solution.state)
    at = equations.layout.flatten(solution.state.coordinates())
    lower, upper = bounds.rows(equations.layout, at)
    assert ((at >= lower) & (at <= upper)).all()
    gradient = equations.gradient()
    on_upper, on_lower = (upper - at).abs() < 1e-14, (at - lower).abs() < 1e-14
    gradient = torch.where(on_upper & (gradient < 0), 0, gradient)
    gradient = torch.where(on_lower & (gradient > 0), 0, gradient)
    assert gradient.abs().max() < 1e-5 * assemble(objective, state).gradient().abs().max()
    assert (on_upper | on_lower).sum() > 2


def test_truth_is_recovered_from_a_perturbed_start():
    objective, truth = toy(windows=1, frames=20, groups=4)
    basis = cosine_basis(3, 20)
    smooth = Frames(basis.mT @ (basis @ truth.frame), truth.shared)
    smooth = Frames(torch.cat((0 * smooth.frame[:, :1], smooth.frame[:, 1:]), -1), truth.shared)
    data = objective.energies["data"]
    seen = torch.tanh((data.matrix @ smooth.frame.unsqueeze(-1)).squeeze(-1))
    exact = Objective(data=Observation(data.matrix, seen), smooth=objective.energies["smooth"])
    solution = solve(exact, truth, STRICT)
    torch.testing.assert_close(solution.state.frame, smooth.frame, rtol=0, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("bounded", [False, True])
def test_batch_equals_loop(bounded):
    objective, state = toy(batch=(2, 2), windows=1, data=0.05)
    bounds = box(state) if bounded else None
    together = solve(objective, state, STRICT, bounds)
    data, smooth = objective.energies["data"], objective.energies["smooth"]
    for place in [(0, 0), (0, 1), (1, 0), (1, 1)]:
        parts = data.matrix[place], data.target[place], data.confidence[place]
        single = Objective(data=Observation(*parts, data.weight), smooth=smooth)
        alone = solve(single, Frames(state.frame[place], state.shared[place]), STRICT, bounds)
        assert together.steps[place] == alone.steps
        torch.testing.assert_close(together.state.frame[place], alone.state.frame)


def test_one_bad_element_never_touches_the_others():
    objective, state = toy(batch=(3,), windows=1)
    good = solve(objective, state, bounds=box(state))
    objective.energies["data"].target[1, 2, 0] = torch.nan
    mixed = solve(objective, state, bounds=box(state))
    assert mixed.status.tolist() == [Status.CONVERGED, Status.NOT_FINITE, Status.CONVERGED]
    for index in (0, 2):
        torch.testing.assert_close(mixed.state.frame[index], good.state.frame[index])
    clamped = state.frame[1].clamp(box(state).lower.frame, box(state).upper.frame)
    torch.testing.assert_close(mixed.state.frame[1], clamped)
    assert mixed.energy[1].isnan()


def test_a_state_that_is_not_finite_is_returned():
    objective, state = toy(batch=(2,), windows=1)
    state.frame[0, 3, 1] = torch.nan
    for method in (LevenbergMarquardt(), Adam()):
        solution = solve(objective, state, method, box(state))
        assert solution.status[0] == Status.NOT_FINITE
        assert solution.state.frame[0, 3, 1].isnan()
        assert solution.state.frame[1].isfinite().all()
        assert solution.energy[1] < objective(state)[1]


def test_an_energy_that_breaks_on_the_way_keeps_the_last_finite_state():
    class Wall(Energy):
        """Not a number beyond 0.5, where the gradient leads."""

        def residual(self, state):
            x = state.values.unsqueeze(-2)
            return Residual((x - 1 + 0 * (0.5 - x).sqrt()).unsqueeze(-2))

    start = Vector(torch.zeros(3, 2, dtype=torch.float64))
    for method in (LevenbergMarquardt(), Adam()):
        solution = solve(Objective(wall=Wall()), start, method)
        assert (solution.status != Status.CONVERGED).all()
        assert solution.state.values.isfinite().all()
        assert (solution.energy.isfinite() & (solution.energy <= 2)).all()


@pytest.mark.long
def test_float32_stops_by_its_own_rule():
    objective, state = toy(windows=1, frames=30, data=1e-4, groups=6)
    exact = solve(objective, state, STRICT, box(state))
    objective.float()
    single = solve(objective, state.to(torch.float32), STRICT, box(state))
    assert single.status == Status.CONVERGED
    assert single.state.frame.dtype == torch.float32
    assert single.energy.item() == pytest.approx(exact.energy.item(), rel=1e-3)


def test_robust_kernel_ignores_an_outlier():
    random = torch.Generator().manual_seed(0)
    matrix = torch.randn(1, 12, 2, generator=random, dtype=torch.float64)
    truth = torch.tensor([[0.3, -0.2]], dtype=torch.float64)
    target = torch.tanh((matrix @ truth.unsqueeze(-1)).squeeze(-1))
    target[:, 4:6] += 5
    start = Frames(torch.zeros_like(truth), truth.new_zeros(0))
    robust = solve(
        Objective(data=Observation(matrix, target, kernel=GemanMcClure(0.1))), start, STRICT
    )
    plain = solve(Objective(data=Observation(matrix, target)), start, STRICT)
    torch.testing.assert_close(robust.state.frame, truth, rtol=0, atol=1e-2)
    assert (plain.state.frame - truth).abs().max() > 0.1


def test_shared_scale_of_a_bundle_is_recovered():
    random = torch.Generator().manual_seed(1)
    matrix = torch.randn(6, 10, 3, generator=random, dtype=torch.float64)
    truth = Frames(
        0.4 * torch.randn(6, 3, generator=random, dtype=torch.float64),
        torch.tensor([0.3, -0.1], dtype=torch.float64),
    )
    energy = Observation(matrix, torch.zeros(6, 10, dtype=torch.float64), shared=True)
    seen = energy.residual(truth).value.flatten(-2)
    exact = Objective(data=Observation(matrix, seen, shared=True))
    start = Frames(0 * truth.frame + 0.05, 0 * truth.shared)
    solution = solve(exact, start, STRICT)
    torch.testing.assert_close(solution.state.frame, truth.frame, rtol=0, atol=1e-6)
    torch.testing.assert_close(solution.state.shared, truth.shared, rtol=0, atol=1e-6)


def test_adam_comes_near_the_same_bounded_minimum():
    objective, state = toy(windows=1)
    exact = solve(objective, state, STRICT, box(state))
    slow = solve(objective, state, Adam(max_steps=800, learning_rate=0.01), box(state))
    assert slow.energy.item() == pytest.approx(exact.energy.item(), rel=1e-3)
    lower, upper = box(state).lower.frame, box(state).upper.frame
    assert ((slow.state.frame >= lower) & (slow.state.frame <= upper)).all()


def test_steps_are_counted_and_said():
    objective, state = toy(batch=(2,), windows=1)
    solution = solve(objective, state, LevenbergMarquardt(max_steps=1))
    assert solution.steps.tolist() == [1, 1]
    assert solution.status.tolist() == [Status.MAX_STEPS] * 2
    assert "element 1: stopped at the largest number of steps" in solution.describe()[1]


def test_a_wrong_jacobian_stalls():
    class Reversed(Observation):
        def linearize(self, state):
            linear = super().linearize(state)
            return type(linear)(linear.residual, -linear.frame)

    data = toy(windows=0)[0].energies["data"]
    solution = solve(Objective(data=Reversed(data.matrix, data.target)), toy(windows=0)[1])
    assert solution.status == Status.STALLED
    assert "forward_mode" in solution.describe()[0]


def test_result_is_detached_even_without_a_step():
    objective, state = toy(windows=1)
    state.frame.requires_grad_()
    solution = solve(objective, state, LevenbergMarquardt(max_steps=0))
    assert not solution.state.frame.requires_grad
    assert not solution.energy.requires_grad


def test_nothing_to_solve_is_named():
    with pytest.raises(InputError, match="0 unknowns"):
        solve(toy()[0], Frames(torch.zeros(7, 0), torch.zeros(0)))


def test_each_state_is_linearized_once_and_rejected_ones_are_only_evaluated():
    class Counted(Observation):
        linearized = evaluated = 0

        def linearize(self, state):
            self.linearized += 1
            return super().linearize(state)

        def forward(self, state):
            self.evaluated += 1
            return super().forward(state)

    objective, state = toy(windows=1)
    data = objective.energies["data"]
    counted = Counted(data.matrix, data.target, data.confidence)
    solution = solve(Objective(data=counted, smooth=objective.energies["smooth"]), state)
    assert solution.status == Status.CONVERGED
    assert counted.linearized <= solution.steps + 1
    assert counted.evaluated == 0

    class Deceived(Counted):
        def linearize(self, state):
            linear = super().linearize(state)
            return type(linear)(linear.residual, -linear.frame)

    deceived = Deceived(data.matrix, data.target, data.confidence)
    solution = solve(Objective(data=deceived), state)
    assert solution.status == Status.STALLED
    assert deceived.linearized == 2
    assert deceived.evaluated == solution.steps - 1
