"""Truths that are relative or of other worlds: other mistakes are told as of any truth."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from swaying_truth import FRAMES, swaying, told, trembling
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.metrics.alignment import root_aligned

ARMS = [0, 1, 5, 6, 7, 2, 3, 4, *range(8, 16)]
SIDES = [0, 1, 5, 6, 7, 2, 3, 4, 12, 13, 14, 15, 8, 9, 10, 11]
NECK, R_ELBOW, R_TOE = LANDMARKS.index("neck"), LANDMARKS.index("r_elbow"), LANDMARKS.index("r_toe")


def elsewhere(joints: Tensor) -> Tensor:
    turn = rotvec_to_matrix(torch.tensor([0.1, 0.8, 0.0]).to(joints))
    return joints @ turn.mT + torch.tensor([1.0, 0.0, 3.0]).to(joints)


def relative(joints: Tensor) -> Tensor:
    return root_aligned(joints)


def of_the_neck(joints: Tensor) -> Tensor:
    return joints - joints[:, NECK : NECK + 1]


def shifted(joints: Tensor) -> Tensor:
    return joints + torch.tensor([3.0, 0.0, 4.0]).to(joints)


Spoilt = Callable[[Tensor], Tensor]
worlds = pytest.mark.parametrize("world", [relative, of_the_neck, elsewhere, shifted])


@pytest.fixture(scope="module")
def joints() -> Tensor:
    """Of a person who walks a little, so that hips do not stay."""
    way = torch.linspace(0, 0.6, FRAMES)[:, None, None] * torch.tensor([1.0, 0.0, 0.4])
    return swaying() + way.to(swaying()) + torch.tensor([0.0, 0.0, 2.0]).to(swaying())


def others(joints: Tensor, truth: Tensor) -> list[str]:
    """What is said beside the world itself, of a result that is a centimetre off."""
    lines = told(joints + 0.01 * trembling(joints), truth)
    world = ("only aligned errors count", "in the world of the cameras")
    left = [line for line in lines if not any(words in line for words in world)]
    assert len(left) < len(lines), lines
    return left


@worlds
def test_right_poses_say_no_more(joints: Tensor, world: Spoilt) -> None:
    assert others(joints, world(joints)) == []


@worlds
def test_exchanged_arms(joints: Tensor, world: Spoilt) -> None:
    (line,) = others(joints, world(joints)[:, ARMS])
    assert "joints of the truth look exchanged" in line
    assert "l_shoulder looks like r_shoulder" in line


@worlds
def test_sides_that_are_exchanged_in_a_part(joints: Tensor, world: Spoilt) -> None:
    true = world(joints)
    (line,) = others(joints, torch.cat((true[:40], true[40:, SIDES])))
    assert line.startswith("in frames 140 to 159 with left and right of the truth exchanged")


@worlds
def test_a_part_that_is_late(joints: Tensor, world: Spoilt) -> None:
    true = world(joints)
    (line,) = others(joints, torch.cat((true[:40], true.roll(8, 0)[40:])))
    assert "with the truth of 8 frames later" in line and "and not in the others" in line


@worlds
def test_a_joint_that_was_not_measured(joints: Tensor, world: Spoilt) -> None:
    for joint, name in ((R_TOE, "r_toe"), (R_ELBOW, "r_elbow")):
        true = world(joints).clone()
        true[:, joint] = 0
        (line,) = others(joints, true)
        assert line.startswith(f"the truth has {name} at 0, 0, 0 in all frames")


def test_the_origin_of_a_truth_was_measured(joints: Tensor) -> None:
    """Joints to which a truth is relative are at zero, in any unit."""
    for joint in (NECK, R_TOE, LANDMARKS.index("r_hip")):
        for size in (1.0, 1.3, 3.28):
            lines = told(joints, size * (joints - joints[:, joint : joint + 1]))
            assert not any("0, 0, 0" in line for line in lines)


def test_axes_of_a_relative_truth(joints: Tensor) -> None:
    lines = told(joints, relative(elsewhere(joints)))
    assert len(lines) == 2 and "relative to them" in lines[0]
    assert lines[1].startswith("after one rotation of all frames by 46 degrees 0% of the error")


def test_the_origin_of_a_truth_beside_a_poor_result(joints: Tensor) -> None:
    """All distances of it are wrong by 20 cm, those from the origin too."""
    poor = joints + 0.25 * trembling(joints)
    lines = told(poor, joints - joints[:, R_TOE : R_TOE + 1])
    assert not any("0, 0, 0" in line for line in lines)
