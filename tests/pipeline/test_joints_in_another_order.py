"""Joints that are given to a refiner under each other's names."""

import warnings

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16, JointSet
from perfcap.pipeline.pose_refiner import PoseRefiner

TAKE = make_take(12, views=3)
PIXELS = TAKE.detections.joints2d


def told(pixels: Tensor, joint_set: JointSet) -> list[str]:
    layer = PoseRefiner(TAKE.actor, joint_set)
    with warnings.catch_warnings(record=True) as lines:
        warnings.simplefilter("always")
        layer(TAKE.cameras, pixels)
        count = len(lines)
        layer(TAKE.cameras, pixels)  # once
    assert len(lines) == count
    return [str(line.message) for line in lines]


def test_joints_in_another_order_are_named() -> None:
    """The person came out decimetres off."""
    other = {"shoulder": "hip", "hip": "shoulder"}
    names = tuple(f"{n[:2]}{other[n[2:]]}" if n[2:] in other else n for n in LANDMARKS)
    lines = told(PIXELS, JointSet("mine", names))
    assert any("order of the joint set" in line for line in lines)


@pytest.mark.long
def test_joints_in_their_order_are_not() -> None:
    noise = torch.randn(PIXELS.shape, generator=torch.Generator().manual_seed(0))
    for size in (0.0, 5.0):
        assert told(PIXELS + size * noise.to(PIXELS), LANDMARKS16) == []
