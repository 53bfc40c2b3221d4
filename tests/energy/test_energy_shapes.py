"""Energies refuse what would be spread over frames, views or joints it is not of."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor, cameras, random_motion

from perfcap.detect.detections import Detections
from perfcap.energy import JointPosition, JointTarget, Reprojection
from perfcap.energy.prior import PosePrior
from perfcap.errors import InputError
from perfcap.solve import Bounds, Objective, solve

pytestmark = pytest.mark.usefixtures("both_twins")
F64 = torch.float64
ACTOR, FRAMES = actor(), 4
MOTION = random_motion(ACTOR.skeleton, FRAMES)
PLACES = ACTOR.joints(MOTION)


def test_places_without_a_source_axis() -> None:
    assert float(JointTarget(ACTOR.landmarks, PLACES[:, None])(MOTION)) < 1e-20
    for target in (PLACES[None], PLACES[:1, None], PLACES[:3, None]):
        with pytest.raises(InputError, match=r"the motion has 4 frames"):
            JointTarget(ACTOR.landmarks, target)(MOTION)


def test_detections_of_other_views_and_frames() -> None:
    views = cameras(2)
    seen = torch.ones(FRAMES, 2, 16, dtype=F64)
    detections = Detections.from_joints(views.project(PLACES), seen)
    assert float(Reprojection(ACTOR.landmarks, views, detections)(MOTION)) < 1e-16
    for wrong in (detections.select([0]), detections.frames(slice(0, 1))):
        energy = Reprojection(ACTOR.landmarks, views, wrong)
        with pytest.raises(InputError, match=r"expected the same frames, views and joints"):
            energy(MOTION)
    with pytest.raises(InputError, match="expected the same frames, views"):
        Reprojection(ACTOR.landmarks, views.select([1]), detections).linearize(MOTION)


def test_solves_refuse_them_too() -> None:
    """Compiled loops would spread one view over another."""
    views = cameras(2)
    seen = Detections.from_joints(views.project(PLACES), torch.ones(FRAMES, 2, 16, dtype=F64))
    for other, shown in ((views, seen.select([0])), (views.select([1]), seen)):
        energy = Reprojection(ACTOR.landmarks, other, shown)
        with pytest.raises(InputError, match="expected the same frames, views and joints"):
            solve(Objective(joints=energy), MOTION)


def test_3d_joints_of_other_views() -> None:
    views, joints = cameras(2), torch.zeros(FRAMES, 2, 16, 3, dtype=F64)
    seen = Detections.from_joints(joints[..., :2], joints[..., 0], joints)
    for other, shown in ((views, seen.select([0])), (views.select([1]), seen)):
        with pytest.raises(InputError, match=r"detections are of \d views, cameras of \d"):
            JointPosition(ACTOR.landmarks, other, shown)


def test_targets_that_are_none() -> None:
    for target in (PLACES, PLACES[0]):
        with pytest.raises(InputError, match="target has shape"):
            JointTarget(ACTOR.landmarks, target)
    with pytest.raises(InputError, match="confidence is -1 at least"):
        JointTarget(ACTOR.landmarks, PLACES[:, None], -torch.ones(FRAMES, 1, 16, dtype=F64))


def test_confidences_below_zero() -> None:
    views = cameras(2)
    seen = Detections.from_joints(views.project(PLACES), -torch.ones(FRAMES, 2, 16, dtype=F64))
    with pytest.raises(InputError, match="confidence2d is -1 at least"):
        Reprojection(ACTOR.landmarks, views, seen)


@pytest.mark.parametrize("size", [(), (1,), (33,)])
def test_bounds_on_rotations_are_refused(size: tuple[int, ...]) -> None:
    """Steps do not add to a rotation vector, so that states left such bounds."""
    objective = Objective(prior=PosePrior(torch.zeros(27, dtype=F64)))
    free = torch.full((33,), torch.inf, dtype=F64)
    free[:3] = 0.5  # places may be bounded
    assert solve(objective, MOTION, bounds=Bounds.on_frames(-free, free)).state.frames == FRAMES
    side = torch.ones(size, dtype=F64)
    with pytest.raises(InputError, match="bounds hold coordinates 3 to 5 of a Motion"):
        solve(objective, MOTION, bounds=Bounds.on_frames(-side, side))


@pytest.mark.parametrize("weight", [-1.0, float("nan")])
def test_weights_are_no_less_than_nothing(weight: float) -> None:
    with pytest.raises(InputError, match="weight is"):
        PosePrior(torch.zeros(27, dtype=F64), weight=weight)


def test_batches_are_spread_as_before() -> None:
    """One clip of detections serves every start of a batch."""
    views = cameras(2)
    detections = Detections.from_joints(views.project(PLACES), torch.ones(FRAMES, 2, 16, dtype=F64))
    energy = Reprojection(ACTOR.landmarks, views, detections)
    both = MOTION.stack([MOTION, replace(MOTION, angles=MOTION.angles + 0.1)])
    found = energy(both)
    assert found.shape == (2,) and float(found[0]) < 1e-16 < float(found[1])
