"""Angles of joints from their rotations."""

from dataclasses import replace

import torch
from synthetic import actor, random_motion, rest_positions

from perfcap.actor.anatomy import human_rig
from perfcap.actor.joint_angles import joint_angles
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.geometry.rotation import rotvec_to_matrix

F64 = torch.float64


def test_rotations_come_back() -> None:
    """Angles, too, but where a shoulder has two sets of them within its limits."""
    skeleton = Skeleton(human_rig(rest_positions(arms=90)))
    share = torch.rand(300, 27, generator=torch.Generator().manual_seed(0), dtype=F64)
    angles = skeleton.lower + (0.02 + 0.96 * share) * (skeleton.upper - skeleton.lower)
    motion = Motion(angles.new_zeros(300, 3), random_motion(skeleton, 300).rotation, angles)
    turned = skeleton(motion).rotation
    found = joint_angles(skeleton, turned)
    again = skeleton(replace(motion, angles=found)).rotation
    joints = skeleton.rig.joints
    square = [k for k, name in enumerate(joints) if not name.endswith("ankle")]
    assert (again - turned)[:, square].abs().max() < 1e-9
    assert (again - turned).abs().max() < 1e-6  # hinges of ankles are not square
    same = ((found - angles).abs().rad2deg() < 1e-6).double().mean(0)
    ankles = torch.tensor(["ankle" in name for name in skeleton.angle_names])
    assert same[~ankles].min() > 0.9
    assert (found - angles)[:, ankles].abs().rad2deg().max() < 1e-5


def test_impossible_turns_stay_within_the_limits() -> None:
    skeleton = actor().skeleton
    vectors = torch.randn(200, 16, 3, generator=torch.Generator().manual_seed(1), dtype=F64)
    found = joint_angles(skeleton, rotvec_to_matrix(2 * vectors))
    assert found.isfinite().all()
    assert (found >= skeleton.lower).all() and (found <= skeleton.upper).all()


def test_the_rest_pose() -> None:
    skeleton = actor().skeleton
    still = torch.eye(3, dtype=F64).expand(2, 16, 3, 3)
    assert torch.allclose(
        joint_angles(skeleton, still), skeleton.rest_angles.expand(2, -1), atol=1e-12
    )
