"""Feet that sink into the floor: values known by hand, derivatives, bad input."""

import pytest
import torch
from checks import check_energy
from synthetic import actor, random_motion

from perfcap.actor.motion import Motion
from perfcap.actor.points import Landmarks
from perfcap.actor.sole_points import sole_skeleton
from perfcap.energy.floor_penetration import FloorPenetration
from perfcap.errors import InputError
from perfcap.solve import Energy
from perfcap.solve.second_order import second_order, twice_differentiated

F64 = torch.float64
ACTOR = actor()
SOLES = sole_skeleton(ACTOR)
POINTS = Landmarks(SOLES, 8)
UP = torch.tensor([0.0, 1.0, 0.0], dtype=F64)


def _alone(motion: Motion, index: int) -> Motion:
    return motion.map(lambda each: each[index])


def test_only_what_is_below_the_floor_counts() -> None:
    rest = ACTOR.skeleton.rest_motion(2)
    ground = float(SOLES.rest_landmarks[-8:, 1].min())
    sure = torch.ones(2, 8, dtype=F64)
    assert FloorPenetration(POINTS, UP, ground - 0.001, sure, unit=0.01)(rest) == 0
    sunk = FloorPenetration(POINTS, UP, ground + 0.02, sure, unit=0.01)(rest)
    assert sunk == pytest.approx(2 * 8 * 4)  # all points of two frames by two units


def test_everything_the_floor_promises() -> None:
    random = torch.Generator().manual_seed(1)
    motion = random_motion(ACTOR.skeleton, 2, (2,), bones=True)
    normal = torch.nn.functional.normalize(torch.tensor([[0.1, 1, 0.2], [0, 1, -0.3]]).to(F64))
    height = torch.tensor([0.1, -0.2], dtype=F64)
    sure = torch.rand(2, 2, 8, generator=random, dtype=F64).requires_grad_()
    depth = (SOLES(motion).landmarks[..., -8:, :] * normal[:, None, None]).sum(-1)
    depth = depth - height[:, None, None]
    assert 0 < int((depth < 0).sum()) < depth.numel()  # or nothing is tested

    def pick(index: int) -> tuple[Energy, Motion]:
        one = FloorPenetration(POINTS, normal[index], height[index], sure[index], unit=0.5)
        return one, _alone(motion, index)

    energy = FloorPenetration(POINTS, normal, height, sure, unit=0.5)
    check_energy(energy, motion, pick=pick, inputs=(sure,), atol=1e-5)


def test_second_derivatives() -> None:
    random = torch.Generator().manual_seed(2)
    motion = random_motion(ACTOR.skeleton, 2, bones=True)
    energy = FloorPenetration(POINTS, UP, 0.0, torch.ones(2, 8, dtype=F64), unit=0.3)
    residual = energy.residual(motion).value
    pull = torch.randn(residual.shape, generator=random, dtype=F64)
    closed = second_order(energy, motion, pull)
    plain = twice_differentiated(lambda at: energy.residual(at).value, motion, pull)
    assert closed is not None
    for found, expected in zip(
        (closed.frame, closed.border, closed.shared),
        (plain.frame, plain.border, plain.shared),
        strict=True,
    ):
        torch.testing.assert_close(found, expected, rtol=1e-7, atol=1e-7)


def test_bad_input() -> None:
    sure = torch.ones(3, 8)
    with pytest.raises(InputError, match="one for each point"):
        FloorPenetration(POINTS, torch.tensor([0.0, 1.0, 0.0]), 0.0, torch.ones(3, 7))
    with pytest.raises(InputError, match="unit vectors"):
        FloorPenetration(POINTS, torch.tensor([0.0, 2.0, 0.0]), 0.0, sure)
