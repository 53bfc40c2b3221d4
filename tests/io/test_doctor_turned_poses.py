"""3D poses in other axes than their camera's: of gravity, of the world, of a crop."""

from __future__ import annotations

import math

import pytest
import torch
from takes import make_take

from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.input_doubts import input_doubts


def told(degrees: float, axis: int, frames: int = 60) -> list[str]:
    take = make_take(frames, turns=0.3)
    poses, chance = take.detections.joints3d, torch.Generator().manual_seed(0)
    assert poses is not None
    about = poses.new_zeros(3)
    about[axis] = math.radians(degrees)
    noise = 0.03 * torch.randn(poses.shape, generator=chance, dtype=poses.dtype)
    turned = poses @ rotvec_to_matrix(about).mT + noise
    seen = type(take.detections).from_joints(
        take.detections.joints2d, take.detections.confidence2d, turned
    )
    return [line for line in input_doubts(take.cameras, seen) if "turned by" in line]


@pytest.mark.parametrize("degrees", [20, -30])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_poses_in_other_axes_are_named(degrees: float, axis: int) -> None:
    """A camera that looks down by 30 degrees put people 24 cm aside of their hips."""
    (line,) = told(degrees, axis)
    assert f"about {abs(degrees)} degrees about {'xyz'[axis]}" in line
    assert "axes of this camera, not those of gravity" in line


@pytest.mark.long
@pytest.mark.parametrize("frames", [10, 60])
def test_poses_in_their_own_axes_are_not(frames: int) -> None:
    assert not told(0, 0, frames)
    assert not told(4, 0, frames)
