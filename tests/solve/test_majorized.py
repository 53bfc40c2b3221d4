"""Energies that are no sum of squares: what the solver sees of them, and where it ends."""

from collections.abc import Collection

import pytest
import torch
from synthetic import actor, random_motion
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.points import Landmarks
from perfcap.energy.prior import PosePrior
from perfcap.errors import InputError
from perfcap.solve import (
    Adjoint,
    Detached,
    Implicit,
    LevenbergMarquardt,
    Newton,
    Objective,
    Sensitivity,
    Unrolled,
    solve,
)
from perfcap.solve.assembly import assemble
from perfcap.solve.layout import Layout
from perfcap.solve.majorized import Expansion, Majorized
from perfcap.solve.stationarity import hessian

F64 = torch.float64


class Wells(Majorized[Motion]):
    """A well ``-exp(-|x - c|^2 / 2 s^2)`` for each point: negative, and not convex."""

    sees: Collection[str] = ()

    def __init__(self, points: Landmarks, centres: Tensor, size: float, **more: float) -> None:
        super().__init__(points, **more)
        self.centres, self.size = centres, size

    def values(self, points: Tensor) -> Tensor:
        return self._depth(points).sum(-1)

    def expand(self, points: Tensor) -> Expansion:
        away, depth = (points - self.centres) / self.size**2, self._depth(points)
        round_ = torch.eye(3).to(points) / self.size**2
        stiff = (-depth)[..., None, None] * round_
        return Expansion(depth.sum(-1), -depth[..., None] * away, stiff)

    def _depth(self, points: Tensor) -> Tensor:
        squared = (points - self.centres).square().sum(-1)
        return -torch.exp(-0.5 * squared / self.size**2)


def problem(offset: float = 20.0) -> tuple[Wells, Motion, Motion]:
    person = actor()
    truth = random_motion(person.skeleton, 3)
    landmarks = person.landmarks
    draw = torch.Generator().manual_seed(1)
    noise = torch.randn(truth.coordinates().frame.shape, generator=draw, dtype=F64)
    here = truth.coordinates()
    start = truth.retract(type(here)(0.03 * noise, here.shared))
    return Wells(landmarks, landmarks(truth), 0.1, offset=offset), truth, start


def test_the_pull_has_the_energys_slope() -> None:
    energy, _, start = problem()
    linear = energy.linearize(start)
    slope = 2 * (linear.frame.flatten(-3, -2).mT @ linear.residual.value.flatten(-2)[..., None])
    draw = torch.Generator().manual_seed(2)
    here = start.coordinates()
    way = torch.randn(here.frame.shape, generator=draw, dtype=F64)
    ahead, behind = (
        energy(start.retract(type(here)(s * 1e-6 * way, here.shared))) for s in (1, -1)
    )
    torch.testing.assert_close(
        (slope.squeeze(-1) * way).sum(), (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-7
    )
    assert linear.value is not None
    torch.testing.assert_close(linear.value, energy(start))


def test_energy_is_reported_and_falls_to_the_truth() -> None:
    energy, truth, start = problem()
    prior = PosePrior(torch.zeros(27, dtype=F64), 100.0, 1e-3)
    solution = solve(Objective(wells=energy, prior=prior), start, LevenbergMarquardt(max_steps=40))
    torch.testing.assert_close(solution.terms["wells"], energy(solution.state))
    assert float(solution.terms["wells"]) < float(energy(start))
    landmarks = energy.points
    before = (landmarks(start) - landmarks(truth)).norm(dim=-1).mean()
    after = (landmarks(solution.state) - landmarks(truth)).norm(dim=-1).mean()
    assert float(before) > 0.02 and float(after) < 0.003


def test_frames_sum_to_the_energy() -> None:
    energy, _, start = problem()
    torch.testing.assert_close(energy.per_frame(start).sum(-1), energy(start))
    both = start.stack([start, start])
    torch.testing.assert_close(energy(both), energy(start).expand(2))


def test_points_without_slope_do_no_harm() -> None:
    energy, _, start = problem()
    far = Wells(energy.points, energy.centres + 50, 0.1, offset=20.0)
    prior = PosePrior(start.angles.mean(0), 1.0, 1e-6)
    solution = solve(Objective(wells=far, prior=prior), start, LevenbergMarquardt(max_steps=3))
    assert bool(torch.isfinite(solution.state.angles).all())
    assert float(solution.terms["wells"]) == 20.0 * 3


@pytest.mark.parametrize("adjoint", [Implicit("products"), Implicit("gauss_newton"), Unrolled()])
def test_gradients_without_its_second_derivatives_are_refused(adjoint: Adjoint) -> None:
    energy, _, start = problem()
    rest = torch.zeros(27, dtype=F64, requires_grad=True)
    objective = Objective(wells=energy, prior=PosePrior(rest, 100.0, 1e-3))
    method = LevenbergMarquardt(max_steps=2)
    with pytest.raises(InputError, match="wells"):
        solve(objective, start, method, adjoint=adjoint)
    assert not solve(objective, start, method, adjoint=Detached()).state.angles.requires_grad


def shaken() -> tuple[Objective, Wells, Motion]:
    """Wells beside where the body can be, so that slopes at the minimum are not zero."""
    energy, truth, start = problem()
    draw = torch.Generator().manual_seed(3)
    moved = 0.03 * torch.randn(energy.centres.shape, generator=draw, dtype=F64)
    energy.centres = (energy.centres + moved).requires_grad_()
    prior = PosePrior(truth.angles.mean(0), 1.0, 0.1)
    return Objective(wells=energy, prior=prior), energy, start


def test_second_derivatives_are_those_of_the_energy() -> None:
    objective, energy, start = shaken()
    objective = Objective(wells=energy)
    layout = Layout.of(start)
    with torch.no_grad():
        found = hessian(objective, start, assemble(objective, start)).curvature[0]
    here = start.coordinates()
    for frame in range(3):

        def value(step: Tensor, frame: int = frame) -> Tensor:
            whole = torch.zeros_like(here.frame).index_put((torch.tensor(frame),), step)
            return energy(start.retract(type(here)(whole, here.shared)))

        whole = torch.autograd.functional.hessian(value, torch.zeros(layout.frame_dim, dtype=F64))
        torch.testing.assert_close(2 * found[frame], whole, rtol=1e-9, atol=1e-9)


def test_gradients_through_a_solve_against_differences() -> None:
    objective, energy, start = shaken()
    method = Newton(LevenbergMarquardt(max_steps=40))
    solution = solve(objective, start, method, adjoint=Implicit())
    assert solution.sensitivity is not None
    assert int(solution.sensitivity) == Sensitivity.EXACT
    way = torch.randn(start.angles.shape, generator=torch.Generator().manual_seed(4), dtype=F64)
    (found,) = torch.autograd.grad((solution.state.angles * way).sum(), energy.centres)
    draw = torch.Generator().manual_seed(5)
    move = 1e-5 * torch.randn(found.shape, generator=draw, dtype=F64)
    centres, values = energy.centres.detach(), []
    for sign in (1, -1):
        energy.centres = centres + sign * move
        moved = solve(objective, start, method).state
        values.append(float((moved.angles * way).sum()))
    change = (values[0] - values[1]) / 2
    assert float((found * move).sum()) == pytest.approx(change, rel=1e-5)
