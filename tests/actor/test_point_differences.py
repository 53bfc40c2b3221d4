"""Vectors between points, and the axes of joints as points."""

import pytest
import torch
from checks import check_energy
from synthetic import actor, random_motion

from perfcap.actor.joint_angles import axes_skeleton, origin_row
from perfcap.actor.motion import Motion
from perfcap.actor.points import Landmarks, PointDifferences
from perfcap.energy.joint_target import JointTarget
from perfcap.errors import InputError
from perfcap.solve.energy import Energy
from perfcap.solve.second_order import twice_differentiated

F64 = torch.float64
ACTOR = actor()
ENDS, STARTS = [3, 4, 0, 3], [2, None, 9, 3]


def test_vectors_and_points() -> None:
    motion = random_motion(ACTOR.skeleton, 3)
    at = ACTOR.joints(motion)
    found = PointDifferences(ACTOR.landmarks, ENDS, STARTS)(motion)
    expected = torch.stack((at[:, 3] - at[:, 2], at[:, 4], at[:, 0] - at[:, 9], 0 * at[:, 3]), 1)
    assert torch.equal(found, expected)


def test_derivatives() -> None:
    random = torch.Generator().manual_seed(0)
    motion = random_motion(ACTOR.skeleton, 2, (2,), bones=True)
    aim = torch.randn(2, 2, 1, 4, 3, generator=random, dtype=F64).requires_grad_()
    points = PointDifferences(ACTOR.landmarks, ENDS, STARTS)

    def pick(index: int) -> tuple[Energy, Motion]:
        return JointTarget(points, aim[index]), motion.map(lambda each: each[index])

    check_energy(JointTarget(points, aim), motion, pick=pick, inputs=(aim,), atol=1e-5)


def test_curvature_is_that_of_the_points() -> None:
    motion = random_motion(ACTOR.skeleton, 2)
    points = PointDifferences(ACTOR.landmarks, ENDS, STARTS)
    pull = torch.randn(2, 4, 3, generator=torch.Generator().manual_seed(1), dtype=F64)
    closed = points.curvature(motion, points.linearize(motion), pull)
    assert torch.allclose(closed.frame, twice_differentiated(points, motion, pull).frame, atol=1e-9)


def test_axes_of_a_joint_are_the_columns_of_its_rotation() -> None:
    motion = random_motion(ACTOR.skeleton, 3)
    pose = ACTOR.skeleton(motion)
    wide = axes_skeleton(ACTOR.skeleton)
    landmarks = Landmarks(wide)(motion)
    assert torch.equal(landmarks[:, :16], pose.landmarks)
    for number, joint in enumerate(ACTOR.skeleton.rig.joints):
        row = origin_row(wide, joint)
        columns = (landmarks[:, row + 1 : row + 4] - landmarks[:, row : row + 1]).mT
        assert torch.allclose(landmarks[:, row], pose.position[:, number], atol=1e-12)
        assert torch.allclose(columns, pose.rotation[:, number], atol=1e-12)


@pytest.mark.parametrize(("ends", "starts"), [([1], [None, 2]), ([16], [0]), ([0], [-1])])
def test_points_that_are_not_there(ends: list[int], starts: list[int | None]) -> None:
    with pytest.raises(InputError, match="expected as many of each, from 0 to 15"):
        PointDifferences(ACTOR.landmarks, ends, starts)
