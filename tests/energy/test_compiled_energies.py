"""Compiled loops of the pose energies against their twins in torch, which gradients ask for."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor, cameras, random_motion
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.trajectory import Trajectory

ACTOR = actor()
FRAMES = 4


def watched(motion: Motion) -> Motion:
    """The same motion where torch records gradients, so that nothing compiled may stand in."""
    return replace(motion, angles=motion.angles.clone().requires_grad_())


def seen(motion: Motion, views: int) -> Detections:
    random = torch.Generator().manual_seed(5)
    local = cameras(views).to_camera(ACTOR.joints(motion))
    noise = 0.1 * torch.randn(local.shape, generator=random, dtype=local.dtype)
    pixels, sure = local[..., :2], torch.ones(local.shape[:-1], dtype=local.dtype)
    return Detections(pixels, sure, local + noise, sure[..., 0] > 0)


def same(own: Tensor | None, other: Tensor | None) -> None:
    assert own is not None
    assert other is not None
    torch.testing.assert_close(own, other.detach(), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("batch", [(), (2,)])
@pytest.mark.parametrize("shape", [False, True])
def test_joint_positions_are_the_same(views: int, batch: tuple[int, ...], shape: bool) -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, batch, bones=shape)
    unit = torch.linspace(0.5, 2, 16, dtype=torch.float64)
    energy = JointPosition(ACTOR.landmarks, cameras(views), seen(motion, views), unit=unit)
    compiled, plain = energy.linearize(motion), energy.linearize(watched(motion))
    same(compiled.residual.value, plain.residual.value)
    same(compiled.frame, plain.frame)
    if shape:
        same(compiled.shared, plain.shared)


@pytest.mark.parametrize("batch", [(), (2, 3)])
def test_features_of_trajectories_are_the_same(batch: tuple[int, ...]) -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, batch)
    turns = torch.linspace(0.0, 9.0, FRAMES, dtype=torch.float64)[:, None]
    motion = replace(motion, rotation=motion.rotation + turns)  # signs of quaternions matter
    angles = torch.linspace(0.5, 2, motion.angles.shape[-1], dtype=torch.float64)
    energy = Trajectory(FRAMES, 2, translation=3.0, rotation=5.0, angles=angles)
    compiled, plain = energy.linearize_features(motion), energy.linearize_features(watched(motion))
    same(compiled[0], plain[0])
    same(compiled[1], plain[1])
    same(compiled[0], energy.features(motion))
