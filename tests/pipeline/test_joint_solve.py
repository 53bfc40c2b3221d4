"""Joints, silhouettes, rigidity and the temporal prior in one solve, and gradients through it."""

from __future__ import annotations

import pytest
import torch
from joint_problem import F64, JointProblem
from torch import Tensor, nn

from perfcap.solve import Adam, Compound, Implicit, LevenbergMarquardt, Objective, Step, solve
from perfcap.solve.adjoint import ProductInverse, tangent_gradient
from perfcap.solve.assembly import assemble
from perfcap.solve.implicit_step import invert
from perfcap.solve.layout import Layout

FINE = LevenbergMarquardt(max_steps=200, tolerance=1e-10, damping=1e-2)


@pytest.fixture(scope="module")
def problem() -> JointProblem:
    return JointProblem()


def off(problem: JointProblem, state: Compound) -> float:
    """Mean distance of the vertices from the truth, m."""
    error = problem.surface(state) - problem.surface(problem.truth)
    return float(error.norm(dim=-1).mean())


@pytest.mark.long
def test_a_known_deformation_is_found_from_exact_masks_of_several_views() -> None:
    several = JointProblem(views=3, size=64, band=4.0)
    objective = several.objective(several.masks, several.joints, weight=1e5, rigid=0.01)
    found = solve(objective, several.start, LevenbergMarquardt(max_steps=20)).state
    assert off(several, several.start) > 0.015
    assert off(several, found) < 0.1 * off(several, several.start)
    # the pose alone does not reach it
    pose = Objective({n: e for n, e in objective.items() if n != "silhouettes"})
    alone = solve(pose, several.start, LevenbergMarquardt(max_steps=20)).state
    assert off(several, found) < 0.1 * off(several, alone)


@pytest.mark.long
def test_adam_and_levenberg_marquardt_reach_the_same_minimum(problem: JointProblem) -> None:
    objective = problem.objective(problem.masks, problem.joints)
    second = solve(objective, problem.start, FINE)
    first = solve(objective, problem.start, Adam(max_steps=400, learning_rate=0.02))
    assert float(second.energy) < 0.6 * float(objective(problem.start))
    gained = float(objective(problem.start)) - float(second.energy)
    assert float(first.energy) == pytest.approx(float(second.energy), abs=0.01 * gained)
    apart = problem.surface(first.state) - problem.surface(second.state)
    assert float(apart.norm(dim=-1).mean()) < 0.01


@pytest.mark.long
def test_gradients_to_masks_and_detections_are_finite_differences(problem: JointProblem) -> None:
    """Through the solve, at masks and joints that nothing fits exactly."""
    random = torch.Generator().manual_seed(2)
    noise = torch.rand(problem.masks.shape, generator=random, dtype=F64)
    masks = (0.05 + 0.8 * problem.masks + 0.1 * noise).requires_grad_()
    shaken = torch.randn(problem.joints.shape, generator=random, dtype=F64)
    joints = (problem.joints + 0.3 * shaken).requires_grad_()
    there = torch.randn(16, 3, generator=random, dtype=F64)
    along = torch.randn(problem.surface(problem.start).shape, generator=random, dtype=F64) / 30

    def read(state: Compound) -> Tensor:
        landmarks = problem.actor.joints(state.parts["motion"])
        return (there * landmarks).sum() + (along * problem.surface(state)).sum()

    with torch.no_grad():
        rough = solve(problem.objective(masks, joints), problem.start, FINE).state
        start = _polished(problem.objective(masks, joints), rough)
    once = LevenbergMarquardt(max_steps=1, tolerance=1e-8)
    found = solve(problem.objective(masks, joints), start, once, adjoint=Implicit("products"))
    slopes = torch.autograd.grad(read(found.state), (masks, joints))
    for which, slope in enumerate(slopes):
        errors = []
        for step in (1e-3, 1e-4, 1e-5):  # a difference may cross where a pixel changes its edge
            ends = []
            for side in (step, -step):
                moved = [masks.detach(), joints.detach()]
                moved[which] = moved[which] + side * slope / slope.norm()
                ends.append(read(_polished(problem.objective(*moved), start)))
            difference = float(ends[0] - ends[1]) / (2 * step)
            errors.append(abs(difference / float(slope.norm()) - 1))
            if errors[-1] < 1e-3:
                break
        assert min(errors) < 1e-3, errors


def _polished(objective: Objective, state: Compound) -> Compound:
    """Exact Newton steps to the very minimum."""
    layout = Layout.of(state)
    zero = torch.zeros(1, layout.unknowns, dtype=F64)
    for _ in range(3):
        slope = tangent_gradient(objective, state, zero) / 2
        good = torch.ones(1, dtype=torch.bool)
        base = invert(None, assemble(objective, state), torch.ones_like(slope), good)
        step = -ProductInverse(base, objective, state, zero).solve(slope)
        moved = layout.unflatten(step)
        state = state.retract(Step(moved.frame, moved.shared))
    return state


@pytest.mark.long
def test_a_network_that_makes_the_masks_learns_through_the_solve(problem: JointProblem) -> None:
    """Fails where the gradient to masks is cut: nothing else leads to the network."""
    torch.manual_seed(0)
    random = torch.Generator().manual_seed(3)
    shade = torch.randn(problem.masks.shape, generator=random, dtype=F64)
    image = torch.stack((problem.masks + 0.2 * shade, shade), -3).flatten(0, 1)
    head = nn.Conv2d(2, 1, 3, padding=1).double()
    with torch.no_grad():
        head.weight.mul_(0.2)
        head.weight[0, 0, 1, 1] += 3
        head.bias.fill_(-1.0)
    truth = problem.surface(problem.truth)

    def loss() -> Tensor:
        masks = head(image).sigmoid().view(problem.masks.shape)
        objective = problem.objective(masks, problem.joints, weight=100.0)
        method = LevenbergMarquardt(max_steps=60, tolerance=1e-7)
        found = solve(objective, problem.start, method, adjoint=Implicit("products")).state
        return 1e3 * (problem.surface(found) - truth).norm(dim=-1).mean()

    before = loss()
    slopes = torch.autograd.grad(before, list(head.parameters()))
    assert all(bool(slope.isfinite().all()) and bool(slope.any()) for slope in slopes)
    with torch.no_grad():
        size = sum(float(slope.square().sum()) for slope in slopes) ** 0.5
        for weight, slope in zip(head.parameters(), slopes, strict=True):
            weight -= 0.05 * slope / size
        after = loss()
    fallen = float(before.detach() - after)
    assert fallen > 0.3 * 0.05 * size  # of what the slope promises
