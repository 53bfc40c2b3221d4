"""Damped, bounded steps in compiled loops against their twin in torch."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from toy import toy

from perfcap.geometry.plain import torch_only
from perfcap.solve import Bounds, LevenbergMarquardt, Step, solve
from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import StepBox
from perfcap.solve.damped_model import DampedModel, damping_scale
from perfcap.solve.levenberg_marquardt import damped_step, room_for_steps

KINDS = {
    "no window": {"windows": 0},
    "a batch of windows": {"windows": 1, "batch": (3,), "data": 1e-2},
    "two windows": {"windows": 2, "frames": 20, "data": 1e-3},
}


def model(kind, width=None, **changes):
    objective, state = toy(**KINDS[kind])
    equations = assemble(objective, state)
    at = equations.layout.flatten(state.coordinates())
    count, random = len(at), torch.Generator().manual_seed(2)
    box = None
    if width is not None:
        room = width * torch.rand(2, *at.shape, generator=random, dtype=torch.float64)
        room[:, :, ::3] = torch.inf  # some are free, some are at a bound already
        room[0, :, 1::6] = 0
        box = StepBox(at, at - room[0], at + room[1])
    here = damping_scale(equations)
    here[:, 1] = 0  # an unknown that nothing sees here
    own = DampedModel(
        equations=equations,
        value=[1e-2 * (1 + b) for b in range(count)],
        undamped=[b == 1 for b in range(count)],
        running=[True] * count,
        here=here,
        scale=3 * here,
        at=at,
        box=box,
        multipliers=torch.randn(at.shape, generator=random, dtype=torch.float64),
    )
    return replace(own, **changes)


def same_steps(problem, room):
    compiled, plain = damped_step(problem, room), damped_step(problem)
    size = float(plain.step.abs().max())
    torch.testing.assert_close(compiled.step, plain.step, rtol=0, atol=1e-9 * size)
    held = float(plain.multipliers.abs().max())
    torch.testing.assert_close(compiled.multipliers, plain.multipliers, rtol=0, atol=1e-8 * held)
    for name in ("damping", "promised", "share"):
        own, other = getattr(compiled, name), getattr(plain, name)
        torch.testing.assert_close(own, other, rtol=1e-9, atol=1e-12)
    assert compiled.valid.tolist() == plain.valid.tolist()
    assert compiled.negligible.tolist() == plain.negligible.tolist()
    return compiled


@pytest.mark.parametrize("width", [None, 1.0, 0.1, 0.01])
@pytest.mark.parametrize("kind", KINDS)
def test_steps_are_the_same(kind, width):
    problem = model(kind, width)
    room = room_for_steps(problem.equations)
    assert room is not None
    found = same_steps(problem, room)
    assert found.valid.all()
    assert (found.promised > 0).all()


def test_a_room_serves_one_step_after_the_other():
    first, second = model("two windows", 0.1), model("two windows", 0.01)
    room = room_for_steps(first.equations)
    before = damped_step(first, room)
    kept = before.step.clone()
    same_steps(second, room)
    assert torch.equal(before.step, kept)  # an earlier answer is not written over
    again = damped_step(first, room)
    assert torch.equal(again.step, kept)


def test_lost_and_finished_elements_stay_where_they_are():
    problem = model("a batch of windows", 0.1)
    curvature = problem.equations.curvature.clone()
    curvature[0, 0, 0, 0] = -1e9
    equations = replace(problem.equations, curvature=curvature)
    problem = replace(problem, equations=equations, running=[True, False, True])
    found = same_steps(problem, room_for_steps(equations))
    assert found.valid.tolist() == [False, False, True]
    assert (found.step[:2] == 0).all()


def test_damping_that_is_not_finite_is_no_step():
    problem = model("no window", value=[float("inf")])
    found = damped_step(problem, room_for_steps(problem.equations))
    assert not found.valid.any()
    assert (found.step == 0).all()


@pytest.mark.long
def test_single_precision_finds_the_same_steps():
    objective, state = toy(windows=1, batch=(2,))
    double = assemble(objective, state)
    single = assemble(objective.to(torch.float32), state.to(torch.float32))
    found = []
    for equations in (double, single):
        like = equations.gradient()
        scale = damping_scale(equations)
        at = equations.layout.flatten(state.coordinates()).to(like)
        box = StepBox(at, at - 0.05, at + 0.05)
        flags = [False] * len(at), [True] * len(at)
        problem = DampedModel(equations, [0.1, 0.1], *flags, scale, scale, at, box, 0 * at)
        found.append(damped_step(problem, room_for_steps(equations)))
    assert found[1].step.dtype == torch.float32
    torch.testing.assert_close(found[1].step.double(), found[0].step, rtol=0, atol=1e-4)


def test_shared_unknowns_and_gradients_are_left_to_torch():
    objective, state = toy(windows=1, shared=2)
    assert room_for_steps(assemble(objective, state)) is None
    objective, state = toy(windows=1)
    equations = assemble(objective, state)
    assert room_for_steps(equations) is not None
    with torch_only():
        assert room_for_steps(equations) is None
    watched = replace(equations, curvature=equations.curvature.clone().requires_grad_())
    assert room_for_steps(watched) is None


@pytest.mark.parametrize("kind", KINDS)
def test_whole_solves_agree(kind):
    objective, state = toy(**KINDS[kind])
    limit = state.frame.new_full((state.frame.shape[-1],), 0.3)
    bounds = Bounds(Step(-limit, -limit[:0]), Step(limit, limit[:0]))
    method = LevenbergMarquardt(100, 1e-12)
    compiled = solve(objective, state, method, bounds)
    with torch_only():
        plain = solve(objective, state, method, bounds)
    assert compiled.steps.tolist() == plain.steps.tolist()
    assert compiled.status.tolist() == plain.status.tolist()
    torch.testing.assert_close(compiled.state.frame, plain.state.frame, rtol=0, atol=1e-7)
