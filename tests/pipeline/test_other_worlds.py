"""Joints in a world whose y is not up, and people who are low in one whose y is."""

import warnings

import pytest
import torch
from synthetic import actor
from torch import Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.joint_motion import JointMotion, require_same_limbs

PERSON = actor()
F64 = torch.float64
LEGS = [JOINTS.index(f"{s}_{n}") for s in "lr" for n in ("hip", "knee", "ankle")]


def turn(angle: float, axis: int = 0) -> Tensor:
    vector = torch.zeros(3, dtype=F64)
    vector[axis] = angle * torch.pi / 180
    return rotvec_to_matrix(vector)


def bowing(trunk: float, legs: float = 0.0) -> Tensor:
    """Joints (20, 16, 3) of who bows by 15 degrees less to more than ``trunk``, y up."""
    rest = PERSON.skeleton.rest_positions[: len(JOINTS)].to(F64)
    hips = rest[[JOINTS.index("l_hip"), JOINTS.index("r_hip")]].mean(0)
    frames = []
    for more in torch.linspace(-15, 15, 20).tolist():
        posed = (rest - hips) @ turn(trunk + more).mT
        posed[LEGS] = (rest[LEGS] - hips) @ turn(legs).mT
        frames.append(posed)
    return torch.stack(frames)


def said(position: Tensor) -> str:
    rotation = torch.eye(3, dtype=F64).expand(*position.shape[:2], 3, 3)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        require_same_limbs(PERSON, JointMotion(rotation, position))
    return " ".join(str(each.message) for each in caught)


@pytest.mark.parametrize(
    ("world", "along"), [(90, "along z"), (-90, "along -z"), (180, "along -y")]
)
def test_who_bows_in_another_world(world: float, along: str) -> None:
    for way in (25.0, -25.0):
        assert along in said(bowing(way) @ turn(world).mT)


def test_who_bows_or_sits_in_a_world_with_y_up() -> None:
    for trunk, legs in ((0.0, 0.0), (25.0, 0.0), (50.0, 0.0), (0.0, -85.0), (30.0, -85.0)):
        assert "expected y up" not in said(bowing(trunk, legs))
