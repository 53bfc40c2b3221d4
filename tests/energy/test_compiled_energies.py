"""Compiled loops of the pose energies against their twins in torch, which gradients ask for."""

import math
from dataclasses import replace

import pytest
import torch
from synthetic import actor, cameras, random_motion
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.prior import PosePrior
from perfcap.energy.reprojection import Reprojection
from perfcap.energy.trajectory import Trajectory
from perfcap.geometry.plain import torch_only
from perfcap.solve import GemanMcClure, Huber, Objective, Quadratic
from perfcap.solve.assembly import assemble
from perfcap.solve.kernels import Kernel

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


def energies(motion: Motion, views: int, kernel: Kernel, weight: Tensor) -> dict[str, object]:
    """One of each energy that adds to the blocks itself, with every input uneven."""
    detections, eye = seen(motion, views), cameras(views)
    random = torch.Generator().manual_seed(6)
    sure = torch.rand(detections.confidence2d.shape, generator=random, dtype=torch.float64)
    sure[..., :3] = 0  # joints that are not seen
    trusted = detections.trusted3d.clone()
    trusted[..., 1, :] = False
    pixels = eye.project(ACTOR.joints(motion))
    pixels = pixels + 9 * torch.randn(pixels.shape, generator=random, dtype=torch.float64)
    detections = replace(detections, joints2d=pixels, confidence2d=sure, trusted3d=trusted)
    unit = torch.linspace(0.05, 0.2, 16, dtype=torch.float64)
    lead = motion.angles.shape[:-2]
    spread = torch.linspace(4.0, 7.0, views, dtype=torch.float64)
    spread = spread * torch.linspace(1, 2, max(1, lead.numel()), dtype=torch.float64)[:, None]
    spread = spread.reshape(*lead, 1, views) if lead else spread[0]
    where = ACTOR.landmarks, eye, detections, weight, kernel
    mean = 0.1 * motion.angles[(0,) * (motion.angles.ndim - 1)]
    return {
        "joints2d": Reprojection(*where, spread),
        "joints3d": JointPosition(*where, unit),
        "prior": PosePrior(mean, 0.4, 0.7, (mean - 0.2, mean + 0.3), 0.1),
    }


@pytest.mark.parametrize("kernel", [Quadratic(), Huber(0.5), GemanMcClure(1.5)])
@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_blocks_are_those_of_the_rows(kernel: Kernel, views: int, batch: tuple[int, ...]) -> None:
    truth = random_motion(ACTOR.skeleton, FRAMES, batch)
    weight = torch.linspace(0.5, 2, 6, dtype=torch.float64)
    every = energies(truth, views, kernel, weight[: math.prod(batch)].reshape(batch))
    moved = replace(truth, angles=truth.angles + 0.1, translation=truth.translation + 0.05)
    for name, energy in every.items():
        objective = Objective({name: energy})
        own = assemble(objective, moved)
        with torch_only():
            other = assemble(objective, replace(moved))
        size = float(other.curvature.abs().max())
        torch.testing.assert_close(own.curvature, other.curvature, rtol=0, atol=1e-12 * size)
        torch.testing.assert_close(own.curvature, own.curvature.mT, rtol=0, atol=1e-12 * size)
        slope = float(other.frame_gradient.abs().max())
        torch.testing.assert_close(
            own.frame_gradient, other.frame_gradient, rtol=0, atol=1e-12 * slope
        )
        torch.testing.assert_close(own.energy, other.energy, rtol=1e-12, atol=0)


def test_joint_positions_do_not_hold_the_translation() -> None:
    """Not even by rounding, which a damping relative to it would magnify."""
    motion = random_motion(ACTOR.skeleton, FRAMES)
    energy = energies(motion, 1, Quadratic(), torch.tensor(1.0, dtype=torch.float64))["joints3d"]
    curvature = assemble(Objective({"joints3d": energy}), motion).curvature
    assert (curvature[..., :3, :] == 0).all()
    assert (curvature[..., :, :3] == 0).all()


@pytest.mark.parametrize("name", ["joints2d", "joints3d", "prior"])
def test_energies_leave_what_they_cannot_add_to_the_rows(name: str) -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES, (), bones=True)
    one = torch.tensor(1.0, dtype=torch.float64)
    energy = energies(motion, 1, Quadratic(), one.clone().requires_grad_())[name]
    dim = motion.frame_dim
    blocks = one.new_zeros(1, FRAMES, dim, dim), one.new_zeros(1, FRAMES, dim)
    if name == "prior":
        motion = watched(motion)
    assert energy.add_to_blocks(motion, *blocks) is None
    assert all((block == 0).all() for block in blocks)


@pytest.mark.parametrize("kernel", [Huber, GemanMcClure])
def test_scales_that_are_tensors_are_left_to_torch(kernel: type[Huber]) -> None:
    motion = random_motion(ACTOR.skeleton, FRAMES)
    one = torch.tensor(1.0, dtype=torch.float64)
    dim = motion.frame_dim
    blocks = one.new_zeros(1, FRAMES, dim, dim), one.new_zeros(1, FRAMES, dim)
    for name, energy in energies(motion, 1, kernel(one), one).items():
        if name != "prior":
            assert energy.add_to_blocks(motion, *blocks) is None
