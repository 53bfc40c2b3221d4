"""Box-constrained steps: optimality, exactness of the bounds, and their fallbacks."""

from __future__ import annotations

import pytest
import torch
from toy import dense_derivatives, toy

from perfcap.errors import InputError
from perfcap.solve import Bounds, Step
from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import StepBox, project
from perfcap.solve.box_step import box_step, feasible_descent
from perfcap.solve.factorization import factorize
from perfcap.solve.layout import Layout
from perfcap.solve.nonnegative import NonnegativeProgram

KINDS = {
    "frames only": {"windows": 0},
    "stiff window": {"windows": 1, "data": 1e-3, "frames": 20},
    "two windows and shared": {"windows": 2, "shared": 2, "data": 1e-2},
    "batch": {"windows": 1, "batch": (5,), "data": 1e-2},
}


def subproblem(kind, width):
    objective, state = toy(**KINDS[kind])
    equations = assemble(objective, state)
    damping = torch.full_like(equations.gradient(), 1e-6)
    at = equations.layout.flatten(state.coordinates())
    random = torch.Generator().manual_seed(2)
    room = width * torch.rand(2, *at.shape, generator=random, dtype=torch.float64)
    room[:, :, ::3] = torch.inf  # some are free, some are at a bound already
    room[0, :, 1::6] = 0
    return objective, state, equations, damping, StepBox(at, at - room[0], at + room[1])


@pytest.mark.parametrize("width", [1.0, 0.1, 0.01])
@pytest.mark.parametrize("kind", KINDS)
def test_step_satisfies_the_optimality_conditions(kind, width):
    _, _, equations, damping, box = subproblem(kind, width)
    factorization = factorize(equations, damping)
    newton = factorization.newton_step(equations)
    step, held = box_step(equations, factorization, damping, newton, box)
    pull = equations.apply(step) + damping * step + equations.gradient() + held
    scale = equations.gradient().abs().amax()
    assert pull.abs().max() < 1e-8 * scale  # stationary
    on_upper = (step - box.highest).abs() < 1e-9
    on_lower = (step - box.lowest).abs() < 1e-9
    assert on_upper[held > 0].all()  # complementary, and of the right sign
    assert on_lower[held < 0].all()
    assert (held != 0).any()


def test_warm_start_gives_the_same_step():
    _, _, equations, damping, box = subproblem("stiff window", 0.1)
    factorization = factorize(equations, damping)
    newton = factorization.newton_step(equations)
    cold, held = box_step(equations, factorization, damping, newton, box)
    random = torch.randn(cold.shape, generator=torch.Generator().manual_seed(3)).double()
    for warm in (held, -held, random.sign()):
        again, _ = box_step(equations, factorization, damping, newton, box, warm)
        torch.testing.assert_close(again, cold, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("width", [1.0, 0.1, 0.01])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("warm", [False, True])
def test_compiled_loops_give_the_same_step(kind, width, warm):
    _, _, equations, damping, box = subproblem(kind, width)
    factorization = factorize(equations, damping)
    newton = factorization.newton_step(equations)
    newton[0, :3] *= 3
    signs = torch.randn(newton.shape, generator=torch.Generator().manual_seed(5)).double().sign()
    given = equations, factorization, damping
    compiled = box_step(*given, newton, box, signs if warm else None)
    plain = box_step(*given, newton.clone().requires_grad_(), box, signs if warm else None)
    for own, other in zip(compiled, plain, strict=True):
        torch.testing.assert_close(own, other.detach(), rtol=1e-7, atol=1e-9 * newton.abs().max())


def test_equal_bounds_fix_a_coordinate():
    _, _, equations, damping, box = subproblem("stiff window", 0.1)
    box = StepBox(box.at, box.lower.clone(), box.upper.clone())
    box.lower[:, 5] = box.upper[:, 5] = box.at[:, 5]
    factorization = factorize(equations, damping)
    newton = factorization.newton_step(equations)
    step, _ = box_step(equations, factorization, damping, newton, box)
    assert (step[:, 5] == 0).all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_clamped_steps_stay_inside_to_the_last_bit(dtype):
    random = torch.Generator().manual_seed(0)
    size = 10.0 ** torch.randint(-6, 4, (3, 4000), generator=random)
    lower, middle, upper = (torch.randn(3, 4000, generator=random) * size).to(dtype).sort(0)[0]
    box = StepBox(middle, lower, upper)
    for direction in (-1e9, 1e9):
        moved = middle + box.clamp(torch.full_like(middle, direction))
        assert ((moved >= lower) & (moved <= upper)).all()
        wanted = lower if direction < 0 else upper
        torch.testing.assert_close(moved, wanted, rtol=1e-6, atol=1e-3)


def test_project_moves_into_the_box_and_leaves_the_rest():
    _, state = toy(shared=2)
    bounds = Bounds(
        Step(torch.tensor([-0.1, -torch.inf, -0.1, -0.1]), torch.tensor([0.05, -1.0])),
        Step(torch.tensor([0.1, torch.inf, 0.2, 0.3]), torch.tensor([0.05, 1.0])),
    )
    inside = project(state, bounds)
    rows = Layout.of(state).flatten(inside.coordinates())
    lower, upper = bounds.rows(Layout.of(state), rows)
    assert ((rows >= lower) & (rows <= upper)).all()
    assert torch.equal(inside.frame[..., 1], state.frame[..., 1])
    assert project(inside, bounds) is inside


@pytest.mark.parametrize(
    ("lower", "upper", "message"),
    [
        (torch.zeros(3), torch.ones(3), "frame shape .3,.*D = 4 unknowns"),
        (torch.ones(4), torch.zeros(4), "lower bound is above its upper"),
        (torch.full((4,), torch.nan), torch.ones(4), "or one is NaN"),
    ],
)
def test_unfit_bounds_are_named(lower, upper, message):
    with pytest.raises(InputError, match=message):
        Bounds.on_frames(lower, upper).rows(Layout.of(toy()[1]), lower)


def test_fallback_stays_inside_and_descends():
    _, _, equations, damping, box = subproblem("stiff window", 0.1)
    uphill = box.clamp(equations.gradient() * 1e3)
    step = feasible_descent(equations, damping, box, uphill)
    assert ((step >= box.lowest) & (step <= box.highest)).all()
    assert (equations.decrease(step) > 0).all()


@pytest.mark.parametrize("condition", [1e1, 1e6])
def test_nonnegative_programs_of_any_support(condition):
    random = torch.Generator().manual_seed(4)
    size, batch = 40, 6
    factor = torch.randn(batch, size, 6, generator=random, dtype=torch.float64)
    matrix = condition * factor @ factor.mT + torch.eye(size, dtype=torch.float64)
    target = condition**0.5 * torch.randn(batch, size, generator=random, dtype=torch.float64)
    usable = torch.rand(batch, size, generator=random) < 0.9
    tolerance = torch.full((batch, 1), 1e-9, dtype=torch.float64)
    program = NonnegativeProgram(matrix, target, usable, tolerance)
    for support in (torch.zeros_like(usable), usable):
        value, done = program.solve(support, 300)
        slope = (matrix @ value.unsqueeze(-1)).squeeze(-1) - target
        assert done.all()
        assert (value >= 0).all() and (value[~usable] == 0).all()
        rounding = 1e-8 * slope.abs().max()
        assert (slope[usable] > -rounding).all()
        assert slope[value > 0].abs().max() < rounding


def test_dense_twin_agrees_on_the_free_step():
    objective, state, equations, damping, _ = subproblem("two windows and shared", 1.0)
    gradient, matrix = dense_derivatives(objective, state)
    step = factorize(equations, damping).newton_step(equations)[0]
    expected = torch.linalg.solve(matrix + damping[0].diag(), -gradient)
    torch.testing.assert_close(step, expected, rtol=1e-8, atol=1e-10)
