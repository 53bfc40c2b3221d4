"""Units that residuals cannot be divided by, and points that are none, are refused by name."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import perfcap
from perfcap.actor import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy import (
    BoneLengthPrior,
    FloorPenetration,
    JointPosition,
    JointTarget,
    PosePrior,
    Reprojection,
    SharedPrior,
    Tether,
    Trajectory,
    UncertainViews,
)
from perfcap.energy.line_distance import LineDistance
from perfcap.errors import InputError
from perfcap.pipeline import TrajectoryConfig, trajectory_prior
from perfcap.solve import Objective, solve

pytestmark = pytest.mark.usefixtures("both_twins")
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


# --- Confidences, frames and shapes that are others -----------------------------------------------


def still(sam: perfcap.Actor, frames: int = 2, **shared: torch.Tensor) -> Motion:
    zero = torch.zeros(frames, 3, dtype=F64)
    return Motion(zero, zero, torch.zeros(frames, len(sam.skeleton.lower), dtype=F64), shared)


@pytest.mark.parametrize("worst", [-1.0, NAN])
def test_confidences_that_are_none(sam, worst):
    """A negative one makes what should be small large, and the solve went that way."""
    camera, seen = views()
    sure, up = torch.full((2, 16), worst, dtype=F64), torch.tensor([0.0, 1, 0], dtype=F64)
    bad = replace(seen, confidence2d=sure[:, None])
    line = torch.zeros(2, 16, 3, dtype=F64)
    for make in (
        lambda: Reprojection(sam.landmarks, camera, bad),
        lambda: UncertainViews(sam.landmarks, camera, bad),
        lambda: JointTarget(sam.landmarks, seen.joints3d, sure[:, None]),
        lambda: FloorPenetration(sam.landmarks, up, 0.0, sure),
        lambda: LineDistance(sam.landmarks, line + up, line, sure),
    ):
        with pytest.raises(InputError, match="at least, expected numbers from 0 on"):
            make()


def test_what_is_unseen_may_be_no_number(sam):
    """As detectors write it; the energy of everything was NaN."""
    camera, seen = views()
    places, poses = seen.joints2d.clone(), seen.joints3d.clone()
    places[0, 0, 3], poses[1] = NAN, NAN
    sure = torch.ones(2, 1, 16, dtype=F64)
    with pytest.raises(InputError, match="joints2d holds NaN"):
        Reprojection(sam.landmarks, camera, replace(seen, joints2d=places, confidence2d=sure))
    with pytest.raises(InputError, match="joints3d holds NaN"):
        JointPosition(sam.landmarks, camera, replace(seen, joints3d=poses))
    sure[0, 0, 3] = 0
    kept = replace(
        seen,
        joints2d=places,
        confidence2d=sure,
        joints3d=poses,
        trusted3d=torch.tensor([[True], [False]]),
    )
    ahead = replace(still(sam), translation=torch.tensor([0.0, 0, 4], dtype=F64).expand(2, 3))
    assert Reprojection(sam.landmarks, camera, kept)(ahead).isfinite()
    assert JointPosition(sam.landmarks, camera, kept)(ahead).isfinite()


def test_energies_of_other_frames(sam):
    """One frame was repeated for all, and priors counted as often as there are frames."""
    camera, seen = views()
    groups = len(sam.skeleton.group_names)
    motion = still(sam, 5, bones=torch.zeros(groups, dtype=F64))
    for energy in (
        JointPosition(sam.landmarks, camera, seen.frames(slice(1))),
        UncertainViews(sam.landmarks, camera, seen.frames(slice(1))),
        BoneLengthPrior(groups, 1),
        SharedPrior(groups, block="bones"),
        Trajectory(4),
    ):
        with pytest.raises(InputError, match=r"frames but the state has 5"):
            energy(motion)
    for energy in (BoneLengthPrior(groups - 1, 5), SharedPrior(3, 5, block="bones")):
        with pytest.raises(InputError, match=f"numbers but the motion shares {groups}"):
            energy(motion)


def test_joints_of_another_number_are_refused(sam):
    """Compiled loops read beyond their ends."""
    camera, seen = views()
    corners = torch.arange(20)[:, None]
    points = SkinnedPoints(sam, corners, torch.ones(20, 1, dtype=F64))
    energy = JointPosition(points, camera, seen)
    for call in (energy, lambda motion: solve(Objective(e=energy), motion)):
        with pytest.raises(InputError, match="points are 20, detections have 16 joints"):
            call(still(sam))


def test_units_and_weights_of_other_things(sam):
    """They broadcast, and ended in a traceback, or not at all."""
    camera, seen = views()
    energy = Reprojection(sam.landmarks, camera, seen, unit=torch.ones(16, dtype=F64))
    with pytest.raises(InputError, match="do its points, views, frames and units fit"):
        energy(still(sam))
    up = torch.tensor([[0.0, 1, 0]] * 2, dtype=F64)
    floor = FloorPenetration(sam.landmarks, up, 0.0, torch.ones(2, 16, dtype=F64))
    with pytest.raises(InputError, match=r"for a state of batch \(\) and 2 frames"):
        solve(Objective(floor=floor), still(sam))
    heavy = JointTarget(sam.landmarks, seen.joints3d + 1, weight=torch.ones(2, dtype=F64))
    with pytest.raises(InputError, match="weights of points and frames are confidences"):
        solve(Objective(heavy=heavy), still(sam))
    late = still(sam, clock=torch.zeros(3, dtype=F64))
    with pytest.raises(InputError, match=r"shares clock of shape \(3,\), expected \(1,\)"):
        UncertainViews(sam.landmarks, camera, seen)(late)
    with pytest.raises(InputError, match="expected one clip of as many views"):
        UncertainViews(sam.landmarks, camera, seen.select([0, 0]))
    with pytest.raises(InputError, match="mean holds NaN"):
        PosePrior(torch.full((3,), NAN, dtype=F64))


def test_unknown_places_and_cameras_that_are_none(sam):
    """Each pulled the person metres away, without a word."""
    camera, seen = views()
    target = torch.rand(2, 2, 16, 3, dtype=F64, generator=torch.Generator().manual_seed(0))
    target[1, 0, 3:5] = 0
    with pytest.raises(InputError, match="several points at 0, 0, 0 in 1 frames"):
        JointTarget(sam.landmarks, target)
    JointTarget(sam.landmarks, target, (target != 0).any(-1).to(F64))
    JointTarget(sam.landmarks, torch.cat((0 * target[:, :, :1], target[:, :, 1:]), 2)[:1])
    mirrored = replace(camera, rotation=-camera.rotation)
    doubled = replace(camera, intrinsics=2 * camera.intrinsics)
    for odd, words in ((mirrored, "rotation that is none"), (doubled, "last row")):
        with pytest.raises(InputError, match=words):
            Reprojection(sam.landmarks, odd, seen)
        with pytest.raises(InputError, match=words):
            JointPosition(sam.landmarks, odd, seen)
        with pytest.raises(InputError, match=words):
            UncertainViews(sam.landmarks, odd, seen)


class OddPoints:
    """Landmarks whose derivative is changed by a function."""

    sees = ()

    def __init__(self, points, change):
        self.points, self.change = points, change

    def __call__(self, motion):
        return self.points(motion)

    def linearize(self, motion):
        points, frame, shared = self.points.linearize(motion)
        return points, self.change(frame), shared


@pytest.mark.parametrize("kind", [Reprojection, JointPosition])
@pytest.mark.parametrize(
    "change",
    [
        lambda moved: moved[:1],
        lambda moved: moved[:, :3],
        lambda moved: moved[..., :3],
        lambda moved: torch.cat((moved, moved), -1),
    ],
)
def test_derivatives_of_other_points_or_unknowns(sam, kind, change):
    """Compiled loops read beyond their ends."""
    energy = kind(OddPoints(sam.landmarks, change), *views())
    with pytest.raises(InputError, match="came with a derivative"):
        solve(Objective(e=energy), still(sam))
