"""Sizes of people in images, which no turn changes."""

import math

import torch
from torch import Tensor

from perfcap.detect.extent import end_to_end
from perfcap.geometry.rotation import rotvec_to_matrix

F64 = torch.float64


def people(dimensions: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    joints = torch.randn(7, 3, 16, dimensions, generator=generator, dtype=F64)
    return joints, torch.rand(7, 3, 16, generator=generator) > 0.4


def test_it_is_the_longest_of_all_distances_between_joints_that_are_seen() -> None:
    joints, seen = people(2)
    found = end_to_end(joints, seen)
    for frame in range(7):
        for view in range(3):
            shown = joints[frame, view][seen[frame, view]]
            torch.testing.assert_close(found[frame, view], torch.cdist(shown, shown).max())


def test_what_is_not_seen_may_be_anywhere() -> None:
    joints, seen = people(2)
    lost = torch.where(seen[..., None], joints, torch.nan)
    assert torch.equal(end_to_end(lost, seen), end_to_end(joints, seen))
    assert (end_to_end(lost, torch.zeros_like(seen)) == 0).all()


def test_turns_change_nothing() -> None:
    for dimensions, axis in ((2, [0.0, 0.0, 1.0]), (3, [0.3, -0.8, 0.5])):
        joints, seen = people(dimensions)
        for angle in (0.3, math.pi / 2, 3.0):
            turn = rotvec_to_matrix(angle * torch.tensor(axis, dtype=F64))
            turned = joints @ turn[:dimensions, :dimensions].mT
            torch.testing.assert_close(end_to_end(turned, seen), end_to_end(joints, seen))


def test_no_gradient_passes() -> None:
    joints, seen = people(2)
    assert not end_to_end(joints.requires_grad_(), seen).requires_grad
