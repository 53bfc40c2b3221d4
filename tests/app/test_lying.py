"""Feet and floors of people who lie."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from synthetic import cameras

from perfcap.app.lying import lying_doubt
from perfcap.app.truth import FILE_PROTOCOL, FoundJoints, Truth
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.io.calibration.rig import CameraRig
from perfcap.io.datasets import DatasetSequence


def person(axis: int) -> torch.Tensor:
    """Joints whose trunk is along an axis of the world, (4, 16, 3) m."""
    joints = torch.rand(4, 16, 3, generator=torch.Generator().manual_seed(0)).double()
    joints[:, LANDMARKS.index("neck"), axis] = 4.0
    return joints


def doubt(joints: torch.Tensor, seen: Camera | None) -> str | None:
    rig = None if seen is None else CameraRig(tuple(f"c{k}" for k in range(len(seen.size))), seen)
    numbers = torch.arange(len(joints))
    sequence = DatasetSequence("rendered", "a", Path("t"), numbers, 30.0, rig=rig, joints3d=joints)
    found = FoundJoints(Path("motion.npz"), joints, numbers.numpy(), 30.0)
    return lying_doubt(found, Truth(sequence, FILE_PROTOCOL, strict=False))


@pytest.mark.parametrize("views", [1, 4])
def test_a_trunk_across_the_images_is_no_axis_of_the_floor(views: int) -> None:
    said = doubt(person(0), cameras(views))
    assert said is not None and "lies across the images" in said
    assert doubt(person(1), cameras(views)) is None


def test_nothing_is_said_without_cameras_or_along_their_way() -> None:
    assert doubt(person(0), None) is None
    assert doubt(person(2), cameras(1)) is None  # as of a ceiling camera above who stands


def test_who_is_as_high_as_long_does_not_lie() -> None:
    joints = person(0)
    joints[:, LANDMARKS.index("l_toe"), 1] = -3.0
    assert doubt(joints, cameras(1)) is None


def test_moving_and_rolled_cameras() -> None:
    still = cameras(1)
    moving = replace(
        still,
        intrinsics=still.intrinsics.expand(4, 1, 3, 3),
        rotation=still.rotation.expand(4, 1, 3, 3),
        translation=still.translation.expand(4, 1, 3),
    )
    assert doubt(person(0), moving) is not None and doubt(person(1), moving) is None
    angle = math.radians(20)
    roll = torch.tensor(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    ).double()
    assert doubt(person(1), replace(still, rotation=roll @ still.rotation)) is None
