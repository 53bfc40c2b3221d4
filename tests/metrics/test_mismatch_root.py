"""Hips and bodies of a truth in different worlds or units are named; depth of one view is not."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.metrics.alignment import root_of
from perfcap.metrics.mismatch_root import root_mismatches


@pytest.fixture(scope="module")
def joints() -> Tensor:
    take = make_take(60)
    walk = torch.arange(60).to(torch.float64)[:, None, None] / 30
    way = torch.cat((walk, 0 * walk, (4 * walk).sin()), -1)
    return take.actor.joints(take.truth) + way + torch.tensor([0.5, 0, 4.0]).to(way)


def captured(joints: Tensor, size: float = 0.02) -> Tensor:
    """Joints with errors that last, as those of captures do."""
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)
    return joints + size * (noise + noise.roll(1, 0) + noise.roll(2, 0))


def with_hips(joints: Tensor, change: Callable[[Tensor], Tensor]) -> Tensor:
    """Only the hips go elsewhere."""
    root = root_of(joints)[:, None]
    return joints - root + change(root)


def with_bodies(joints: Tensor, matrix: Tensor) -> Tensor:
    """Only the bodies are turned, about their hips."""
    root = root_of(joints)[:, None]
    return root + (joints - root) @ matrix.mT


def turn(degrees: float) -> Tensor:
    return rotvec_to_matrix(torch.tensor([0, degrees, 0], dtype=torch.float64).deg2rad())


def told(estimate: Tensor, truth: Tensor) -> list[str]:
    return list(root_mismatches(estimate, truth, torch.ones(truth.shape[:-1], dtype=torch.bool)))


@pytest.mark.parametrize("factor", [100.0, 3.28, 2.0, 0.5])
def test_hips_in_another_unit(joints: Tensor, factor: float) -> None:
    (line,) = told(captured(joints), with_hips(joints, lambda root: factor * root))
    found = float(line.split("the truth is ")[1].split(" times")[0])
    assert found == pytest.approx(factor, rel=0.03) and "one unit" in line


@pytest.mark.parametrize("axes", [(0.0, 90.0), (0.0, 30.0), (180.0, 0.0)])
def test_hips_in_another_world(joints: Tensor, axes: tuple[float, float]) -> None:
    about = torch.tensor([*axes, 0.0], dtype=torch.float64).deg2rad()
    truth = with_hips(joints, lambda root: root @ rotvec_to_matrix(about).mT)
    (line,) = told(captured(joints), truth)
    assert "is turned or mirrored, " in line


def test_hips_in_a_mirror(joints: Tensor) -> None:
    truth = with_hips(joints, lambda root: root * torch.tensor([1.0, 1, -1]).to(root))
    (line,) = told(captured(joints), truth)
    assert "is turned or mirrored, " in line


def test_hips_at_a_place_that_no_view_has(joints: Tensor) -> None:
    """Nothing explains it, but no depth is so far off."""
    way = torch.randn((60, 1, 3), generator=torch.Generator().manual_seed(1)).to(joints)
    (line,) = told(captured(joints), with_hips(joints, lambda root: root + 3 * way))
    assert "the hips are 4." in line and "check world and unit of the hips" in line


@pytest.mark.parametrize("degrees", [20.0, 90.0, 180.0])
def test_bodies_in_another_world(joints: Tensor, degrees: float) -> None:
    (line,) = told(captured(joints, 0.01), with_bodies(joints, turn(degrees)))
    found = float(line.split("about their hips by ")[1].split(" degrees")[0])
    assert found == pytest.approx(degrees, abs=2)


def test_bodies_in_a_mirror(joints: Tensor) -> None:
    mirror = torch.diag(torch.tensor([-1.0, 1, 1], dtype=torch.float64))
    (line,) = told(captured(joints), with_bodies(joints, mirror))
    assert "with bodies of the truth in a mirror" in line


def test_a_truth_in_one_other_world_is_left_to_others(joints: Tensor) -> None:
    assert told(captured(joints), joints @ turn(90).mT) == []
    assert told(captured(joints), joints + torch.tensor([3.0, 0, 0]).to(joints)) == []


@pytest.mark.parametrize("size", [0.15, 0.4])
def test_depth_of_one_view_says_nothing(joints: Tensor, size: float) -> None:
    """Also where it makes the way of the hips longer, or wave towards the camera."""
    time = torch.arange(60).to(torch.float64)[:, None]
    towards = torch.nn.functional.normalize(root_of(joints), dim=-1)
    for wave in (size * (time / 9).sin(), size * time / 30, size + 0 * time):
        assert told(captured(joints + (wave * towards)[:, None]), joints) == []
    assert told(captured(1.2 * joints), joints) == []


def test_a_motion_without_anything_in_common_is_no_short_way(joints: Tensor) -> None:
    """Any way is as near as it can be to a truth that shrinks to its middle."""
    assert not any("times as long" in line for line in told(captured(joints.flip(0)), joints))


def test_too_few_frames_and_hips_that_are_not_known(joints: Tensor) -> None:
    truth = with_hips(joints, lambda root: 100 * root)
    assert told(captured(joints)[:9], truth[:9]) == []
    valid = torch.ones(60, 16, dtype=torch.bool)
    valid[:, 8] = False
    assert list(root_mismatches(captured(joints), truth, valid)) == []
