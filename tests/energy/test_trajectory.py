"""Smoothness of windows, whatever the person does."""

import math

import pytest
import torch
from checks import check_energy
from synthetic import random_motion, rest_positions
from torch import Tensor

from perfcap.actor.anatomy import human_rig
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.energy.trajectory import Trajectory
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.solve.energy import WindowEnergy
from perfcap.temporal.subspace import dct_basis

F64 = torch.float64
FRAMES, RANK = 50, 8
SKELETON = Skeleton(human_rig(rest_positions()))


def spin(turns: float) -> Motion:
    """A person turning at constant speed about the vertical, rotation vectors in one turn."""
    angle = torch.linspace(0, 2 * math.pi * turns, FRAMES, dtype=F64)
    axis = torch.tensor([0.0, 1.0, 0.0], dtype=F64)
    wrapped = matrix_to_rotvec(rotvec_to_matrix(angle[:, None] * axis))
    rest = SKELETON.rest_motion(FRAMES)
    return Motion(rest.translation, wrapped, rest.angles)


def outside(values: Tensor) -> Tensor:
    """Energy of (F, n) outside the subspace."""
    basis = dct_basis(FRAMES, RANK, dtype=F64)
    return (values - basis.mT @ (basis @ values)).square().sum()


@pytest.mark.parametrize("turns", [1.0, 3.0])
def test_spinning_costs_little(turns: float) -> None:
    """Where the rotation vector tears, the quaternion is two slow sinusoids."""
    motion = spin(turns)
    energy = Trajectory(FRAMES, RANK)(motion)
    torn = outside(motion.rotation)
    assert torn > 20
    assert energy < 0.05 * torn
    smooth = torch.linspace(0, math.pi * turns, FRAMES, dtype=F64)
    exact = outside(2 * torch.stack((smooth.cos(), smooth.sin()), -1))
    assert torch.allclose(energy, exact, rtol=1e-5)


def test_the_sign_of_a_quaternion_does_not_matter() -> None:
    """Motions that differ by full turns are the same motion."""
    motion = spin(1.0)
    longer = motion.rotation * (1 - 2 * math.pi / motion.rotation.norm(dim=-1, keepdim=True))
    longer = torch.where(motion.rotation.norm(dim=-1, keepdim=True) > 0.1, longer, motion.rotation)
    other = Motion(motion.translation, longer, motion.angles)
    energy = Trajectory(FRAMES, RANK)
    assert torch.allclose(energy(other), energy(motion), atol=1e-9)


def test_motions_inside_the_subspace_are_free() -> None:
    random = torch.Generator().manual_seed(3)
    basis = dct_basis(FRAMES, RANK, dtype=F64)

    def smooth(count: int) -> Tensor:
        return basis.mT @ torch.randn(RANK, count, generator=random, dtype=F64)

    still = torch.tensor([0.4, 1.0, -0.3], dtype=F64).expand(FRAMES, 3)
    motion = Motion(smooth(3), still, smooth(27))
    energy = Trajectory(FRAMES, RANK, 50.0, translation=3.0, rotation=2.0, angles=4.0)
    assert energy(motion) < 1e-20
    noisy = Motion(motion.translation, still, motion.angles + 0.1 * smooth(27).flip(0).cos())
    assert energy(noisy) > 1e-3


def test_energy_is_the_published_sum() -> None:
    motion = random_motion(SKELETON, FRAMES)
    motion = Motion(motion.translation, spin(0.8).rotation, motion.angles)
    weights = torch.linspace(0.5, 2, 27, dtype=F64)
    energy = Trajectory(FRAMES, RANK, 50.0, translation=2.0, rotation=3.0, angles=weights)
    parts = (
        outside(2.0 * motion.translation),
        outside(weights * motion.angles),
        9.0 * Trajectory(FRAMES, RANK, translation=0.0, angles=0.0)(motion),
    )
    assert torch.allclose(energy(motion), 50.0 * torch.stack(parts).sum())


@pytest.mark.parametrize("batch", [(), (2,)])
def test_derivative_of_features(batch: tuple[int, ...]) -> None:
    motion = random_motion(SKELETON, 6, batch)
    energy = Trajectory(6, 3, 50.0, translation=2.0, rotation=3.0, angles=1.5)
    features, jacobian = energy.linearize_features(motion)
    exact = WindowEnergy.linearize_features(energy, motion)
    assert torch.allclose(features, exact[0], atol=1e-14)
    assert torch.allclose(jacobian, exact[1], atol=1e-12)


def test_features_move_as_fast_as_the_rotation() -> None:
    jacobian = Trajectory(6, 3).linearize_features(random_motion(SKELETON, 6))[1]
    turn = jacobian[..., 3:7, 3:6]
    metric = turn.mT @ turn
    assert torch.allclose(metric, torch.eye(3, dtype=F64).expand_as(metric), atol=1e-12)


def test_everything_an_energy_promises() -> None:
    motion = random_motion(SKELETON, 6, (2,))
    motion = Motion(motion.translation, 0.3 * motion.rotation, motion.angles)
    energy = Trajectory(6, 3, 5.0, translation=2.0, rotation=3.0, angles=1.5)

    def pick(i: int) -> tuple[WindowEnergy, Motion]:
        return energy, Motion(motion.translation[i], motion.rotation[i], motion.angles[i])

    check_energy(energy, motion, pick=pick)


def test_a_soft_edge_penalises_in_proportion() -> None:
    keep = torch.tensor([1.0, 1.0, 0.75, 0.0], dtype=F64)
    energy = Trajectory(FRAMES, keep=keep)
    basis = dct_basis(FRAMES, 4, dtype=F64)
    for row, kept in zip(basis, keep, strict=True):
        still = SKELETON.rest_motion(FRAMES)
        motion = Motion(still.translation, still.rotation, row[:, None].expand(FRAMES, 27))
        assert torch.allclose(energy(motion), 27 * (1 - kept) ** 2, atol=1e-12)


def test_short_windows_are_free() -> None:
    motion = random_motion(SKELETON, 3)
    assert Trajectory(3, 8)(motion) < 1e-20
