"""Units that residuals cannot be divided by, and points that are none, are refused by name."""

from __future__ import annotations

import pytest
import torch

import perfcap
from perfcap.actor import Motion
from perfcap.energy import (
    FloorPenetration,
    JointPosition,
    JointTarget,
    PosePrior,
    Reprojection,
    SharedPrior,
    Tether,
    Trajectory,
)
from perfcap.errors import InputError
from perfcap.pipeline import TrajectoryConfig, trajectory_prior

F64 = torch.float64
NAN = float("nan")


@pytest.fixture(scope="module")
def sam() -> perfcap.Actor:
    return perfcap.load_actor("sam")


def views() -> tuple[perfcap.Camera, perfcap.Detections]:
    turn = torch.eye(3, dtype=F64)[None]
    camera = perfcap.Camera(turn, turn, torch.zeros(1, 3, dtype=F64))
    joints = torch.zeros(2, 1, 16, 3, dtype=F64)
    return camera, perfcap.Detections.from_joints(joints[..., :2], joints[..., 0], joints)


@pytest.mark.parametrize("unit", [0.0, -1.0, NAN, torch.zeros(1, dtype=F64)])
def test_units_that_are_none(sam, unit):
    camera, seen = views()
    ones, up = torch.ones(2, 16, dtype=F64), torch.tensor([0.0, 1, 0], dtype=F64)
    for make in (
        lambda: Reprojection(sam.landmarks, camera, seen, unit=unit),
        lambda: JointPosition(sam.landmarks, camera, seen, unit=unit),
        lambda: JointTarget(sam.landmarks, seen.joints3d, unit=unit),
        lambda: FloorPenetration(sam.landmarks, up, 0.0, ones, unit=unit),
        lambda: Tether(4, unit=unit),
    ):
        with pytest.raises(InputError, match=r"unit is .* expected a number above zero"):
            make()


@pytest.mark.parametrize("size", [0.0, -1.0, NAN])
def test_deviations_that_are_none(size):
    rest, lower = torch.zeros(3, dtype=F64), -torch.ones(3, dtype=F64)
    with pytest.raises(InputError, match="deviation is"):
        PosePrior(rest, size)
    with pytest.raises(InputError, match="beyond is"):
        PosePrior(rest, usual=(lower, -lower), beyond=size)
    with pytest.raises(InputError, match="deviation is"):
        SharedPrior(4, deviation=size)
    with pytest.raises(InputError, match="a lower end is above its upper end"):
        PosePrior(rest, usual=(-lower, lower))


def test_scales_and_rates_that_are_none():
    for name in ("translation", "rotation", "angles"):
        with pytest.raises(InputError, match=f"{name} is -1"):
            Trajectory(12, **{name: torch.tensor([1.0, -1.0], dtype=F64)})
        Trajectory(12, **{name: 0.0})  # what counts for nothing
    with pytest.raises(InputError, match="rate is -30"):
        trajectory_prior(TrajectoryConfig(), 12, -30.0)


def test_units_may_be_infinite(sam):
    """A joint that a set lacks counts for nothing."""
    camera, seen = views()
    unit = torch.full((16,), 0.05, dtype=F64)
    unit[0] = torch.inf
    zero = torch.zeros(2, 3, dtype=F64)
    motion = Motion(zero, zero, torch.zeros(2, len(sam.skeleton.lower), dtype=F64))
    energy = JointTarget(sam.landmarks, sam.joints(motion)[:, None], unit=unit)
    assert float(energy(motion)) == 0
    JointPosition(sam.landmarks, camera, seen, unit=unit)


def test_an_actor_is_no_points(sam):
    camera, seen = views()
    with pytest.raises(InputError, match=r"got a Actor.* such as actor\.landmarks"):
        Reprojection(sam, camera, seen)
