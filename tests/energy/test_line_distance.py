"""Lines: distance, derivatives, recovery of a pose from rays, errors of limbs."""

import pytest
import torch
from checks import check_energy
from synthetic import actor, random_motion
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.energy.line_distance import LineDistance, limb_errors, line_through
from perfcap.errors import InputError
from perfcap.solve import Energy, LevenbergMarquardt, Objective, solve
from perfcap.solve.energy import Step

F64 = torch.float64
ACTOR = actor()


def lines(points: Tensor, seed: int = 0) -> tuple[Tensor, Tensor]:
    """A line through each point, in a direction of its own."""
    random = torch.Generator().manual_seed(seed)
    return line_through(points, torch.randn(points.shape, generator=random, dtype=F64))


def test_norm_is_the_distance() -> None:
    motion = random_motion(ACTOR.skeleton, 2)
    joints = ACTOR.landmarks(motion)
    direction, moment = lines(joints)
    # moved along a line nothing changes, across it all does
    across = torch.linalg.cross(direction, direction.roll(1, -1))
    across = across / torch.linalg.vector_norm(across, dim=-1, keepdim=True)
    moved = line_through(joints + 3 * direction + 0.25 * across, direction)
    squared = LineDistance(ACTOR.landmarks, *moved, unit=0.5).residual(motion).squared_norm()
    torch.testing.assert_close(squared, torch.full_like(squared, 0.25))
    assert LineDistance(ACTOR.landmarks, direction, moment)(motion) < 1e-25


def test_everything_an_energy_promises() -> None:
    motion = random_motion(ACTOR.skeleton, 2, (2,), bones=True)
    random = torch.Generator().manual_seed(1)
    places = torch.randn(2, 2, 16, 3, generator=random, dtype=F64)
    direction, moment = lines(places)
    moment = moment.requires_grad_()
    certain = torch.rand(2, 2, 16, generator=random, dtype=F64).requires_grad_()
    energy = LineDistance(ACTOR.landmarks, direction, moment, certain, weight=0.7, unit=0.5)

    def pick(index: int) -> tuple[Energy, Motion]:
        alone = Motion(
            motion.translation[index],
            motion.rotation[index],
            motion.angles[index],
            {"bones": motion.shared["bones"][index]},
        )
        given = direction[index], moment[index], certain[index]
        return LineDistance(ACTOR.landmarks, *given, weight=0.7, unit=0.5), alone

    check_energy(energy, motion, pick=pick, inputs=(moment, certain), atol=1e-5)


def test_rays_of_two_views_recover_the_joints() -> None:
    truth = random_motion(ACTOR.skeleton, 2)
    joints = ACTOR.landmarks(truth)
    objective = Objective(
        {str(k): LineDistance(ACTOR.landmarks, *lines(joints, k)) for k in range(2)}
    )
    random = torch.Generator().manual_seed(5)
    size = (2, truth.frame_dim)
    off = Step(0.05 * torch.randn(size, generator=random, dtype=F64), torch.zeros(0, dtype=F64))
    start = truth.retract(off)
    before = (ACTOR.landmarks(start) - joints).norm(dim=-1).mean()
    found = solve(objective, start, LevenbergMarquardt())
    after = (ACTOR.landmarks(found.state) - joints).norm(dim=-1).max()
    assert before > 0.02
    assert after < 1e-4


def test_errors_of_limbs() -> None:
    squared = torch.tensor([[100.0, 900.0, 500.0, torch.nan]], dtype=F64)
    confidence = torch.tensor([[1.0, 0.5, 1.0, 0.0]], dtype=F64)
    limb = torch.tensor([[0, 0, 2, 2]])
    errors = limb_errors(squared, confidence, limb, 4)
    assert errors.tolist() == [[500.0, 0.0, 500.0, 0.0]]


def test_bad_input() -> None:
    direction, moment = lines(torch.ones(2, 16, 3, dtype=F64))
    with pytest.raises(InputError, match=r"give \(\*b, F, 16, 3\)"):
        LineDistance(ACTOR.landmarks, direction[:, :5], moment[:, :5])
    with pytest.raises(InputError, match="length one"):
        LineDistance(ACTOR.landmarks, 2 * direction, moment)
    with pytest.raises(InputError, match="from 0 on"):
        LineDistance(ACTOR.landmarks, direction, moment, -torch.ones(2, 16, dtype=F64))
    none = LineDistance(ACTOR.landmarks, direction * torch.nan, moment, torch.zeros(2, 16).double())
    assert none(random_motion(ACTOR.skeleton, 2)) == 0
    with pytest.raises(InputError, match="2 frames but the motion 3"):
        none(random_motion(ACTOR.skeleton, 3))
