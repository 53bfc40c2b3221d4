"""Joint sets that lack landmarks in the middle of limbs, at their ends, or by a slip of the pen."""

from __future__ import annotations

import warnings

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, JointSet
from perfcap.detect.retarget import bone_vectors, filled, mid_hip, retarget
from perfcap.pipeline import PoseRefiner

TAKE = make_take(10)
JOINTS = TAKE.actor.joints(TAKE.truth)
PLACES = TAKE.cameras.to_camera(JOINTS)
LOCAL = PLACES - mid_hip(PLACES).unsqueeze(-2)
PIXELS = TAKE.detections.joints2d
LENGTHS = bone_vectors(TAKE.actor.skeleton.rest_landmarks).norm(dim=-1)
ENDS = ("r_wrist", "l_wrist", "r_ankle", "l_ankle")


def without(*names: str) -> tuple[JointSet, list[int]]:
    """A set of the other landmarks, and which these are."""
    kept = [place for place, name in enumerate(LANDMARKS) if name not in names]
    return JointSet("mine", tuple(LANDMARKS[place] for place in kept)), kept


def refine(
    *names: str, places: Tensor = LOCAL, pixels: bool = True, placed: bool = False
) -> Tensor:
    """Landmarks (F, 16, 3) of a set without some names."""
    joint_set, kept = without(*names)
    layer = PoseRefiner(TAKE.actor, joint_set=joint_set).eval()
    joints2d = PIXELS[:, :, kept] if pixels else None
    found: Tensor = layer(TAKE.cameras, joints2d, joints3d=places[:, :, kept], placed=placed).joints
    return found


def errors(joints: Tensor, name: str) -> float:
    """Mean distance (F, 16, 3) of a landmark from the truth, about the hips, metres."""
    off = joints - mid_hip(joints).unsqueeze(-2) - (JOINTS - mid_hip(JOINTS).unsqueeze(-2))
    return float(off[:, LANDMARKS.index(name)].norm(dim=-1).mean())


@pytest.mark.parametrize(
    "names", [("r_elbow",), ("r_knee",), ("r_elbow", "l_elbow"), ("r_knee", "r_ankle")]
)
def test_bones_beyond_a_lacking_landmark_lead_to_the_next_one(names: tuple[str, ...]) -> None:
    lost = [LANDMARKS.index(name) for name in names]
    lacking = LOCAL.clone()
    lacking[..., lost, :] = 0
    lengths = bone_vectors(LOCAL).norm(dim=-1)[0, 0]
    for scale in (1.0, 1.1):  # a network's people are of another size
        found = retarget(filled(scale * lacking, lengths, names), lengths)
        off = (found - LOCAL).norm(dim=-1).amax((0, 1))
        off[lost] = 0
        assert float(off.max()) < 0.02


def test_straight_limbs_have_finite_derivatives() -> None:
    pose = LOCAL.clone()
    shoulder, elbow, wrist = (
        LANDMARKS.index(f"r_{name}") for name in ("shoulder", "elbow", "wrist")
    )
    pose[..., wrist, :] = (
        3 * (pose[..., elbow, :] - pose[..., shoulder, :]) + pose[..., shoulder, :]
    )
    for poses in (pose, torch.zeros_like(pose)):
        poses.requires_grad_()
        filled(poses, LENGTHS, ("r_elbow", "head_top")).sum().backward()
        assert poses.grad is not None
        assert poses.grad.isfinite().all()
        assert float(poses.grad.abs().max()) < 100


@pytest.mark.parametrize("names", [("r_elbow",), ("r_knee",), ("r_elbow", "l_elbow")])
def test_sets_without_joints_of_limbs_refine_as_those_that_have_them(
    names: tuple[str, ...],
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, whole = refine(*names), refine()
    for name in (*ENDS, *names):
        assert errors(found, name) < errors(whole, name) + 0.03
