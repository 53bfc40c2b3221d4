"""Truths of other worlds, frames, sides and orders are told; errors of captures are not."""

from __future__ import annotations

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.metrics import mismatches
from perfcap.metrics.alignment import root_aligned

ORDER = LANDMARKS16.mirrored()


@pytest.fixture(scope="module")
def joints() -> Tensor:
    take = make_take(60)
    return take.actor.joints(take.truth)


def told(estimate: Tensor, truth: Tensor, valid: Tensor | None = None) -> tuple[str, ...]:
    everything = torch.ones(truth.shape[:-1], dtype=torch.bool)
    return mismatches(estimate, truth, everything if valid is None else valid, ORDER)


@pytest.mark.parametrize("size", [0.0, 0.03, 0.2])
def test_errors_of_a_capture_are_not_explained(joints: Tensor, size: float) -> None:
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)
    slow = noise.cumsum(0) / (1 + torch.arange(60)[:, None, None]).sqrt()
    offset = torch.tensor([0.1, 0.0, 2 * size]).to(joints)
    if size < 0.2:
        assert told(joints + size * slow + offset, joints) == ()
    else:
        assert not any("exchanged" in line or "rotation" in line for line in told(
            joints + size * slow + offset, joints
        ))  # fmt: skip


def test_a_truth_with_another_origin(joints: Tensor) -> None:
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)
    away = torch.tensor([3.0, 0.0, -4.0]).to(joints)
    (line,) = told(joints + 0.03 * noise + away, joints)
    assert line.startswith("after one shift of all frames by 5 m 1% of the error is left")
    assert told(joints + 0.03 * noise + 0.3 * away, joints) == ()
    (line,) = told(joints + 0.01 * noise + 0.2 * away, joints)  # as of several views
    assert line.startswith("after one shift of all frames by 1 m 2% of the error is left")


@pytest.mark.parametrize("size", [1 / 0.3048, 0.3])
def test_a_truth_in_feet(joints: Tensor, size: float) -> None:
    line, *_ = told(joints, size * joints)
    assert f"{size:.2f} times as large" in line and "metres" in line


def test_frames_that_are_late(joints: Tensor) -> None:
    (line,) = told(joints[:-5], joints[5:])
    assert "5 frames earlier" in line
    (line,) = told(joints[5:], joints[:-5])
    assert "5 frames later" in line


def test_frames_that_are_late_are_counted_by_their_numbers(joints: Tensor) -> None:
    """Where every third frame has truth, a row later is three frames."""
    found, true = joints[::3][1:], joints[::3][:-1]
    valid = torch.ones(true.shape[:-1], dtype=torch.bool)
    (line,) = mismatches(found, true, valid, ORDER, frames=range(3, 60, 3))
    assert "with the truth of 3 frames later" in line


@pytest.mark.parametrize("elsewhere", [False, True])
@pytest.mark.parametrize("late", [-1, 1])
def test_one_frame_is_most_of_the_error_of_a_good_capture(
    joints: Tensor, late: int, elsewhere: bool
) -> None:
    """Several views place joints to a centimetre: errors of 2 and 3 cm were taken as theirs."""
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)
    found = joints + 0.003 * noise
    if elsewhere:  # half a metre off, as one view's depth is
        found = found + torch.tensor([0.0, 0.0, 0.5]).to(joints)
    assert told(found, joints) == ()
    first, last = slice(0, -1), slice(1, None)
    here, there = (first, last) if late < 0 else (last, first)
    (line,) = told(found[here], joints[there])
    assert f"of 1 frame {'later' if late > 0 else 'earlier'}" in line
    assert ("aligned frame by frame" in line) == elsewhere


@pytest.mark.parametrize("rate", [2.0, 0.5, 1.2])
def test_another_frame_rate(joints: Tensor, rate: float) -> None:
    """Without its rate and numbers of frames, a truth of 60 frames a second was taken as of 30."""
    times = (torch.arange(60) / rate).clamp(max=59)
    before = times.floor().long()
    share = (times - before).to(joints)[:, None, None]
    resampled = joints[before] * (1 - share) + joints[(before + 1).clamp(max=59)] * share
    lines = told(joints, resampled)
    assert any(f"a truth of {rate:.3g} times the frame rate" in line for line in lines)


@pytest.mark.parametrize("far", [2.0, 5.0])
def test_a_truth_that_drifts_has_no_other_rate(joints: Tensor, far: float) -> None:
    """A quarter of its frames drift by a quarter: it was called 0.25 times the frame rate."""
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)
    drift = torch.linspace(0, far, 60)[:, None, None] * torch.tensor([1.0, 0.0, 0.3])
    found = joints + 0.02 * noise
    assert not any("frame rate" in line for line in told(found, joints + drift.to(joints)))
    hips = joints[:, [8, 12]].mean(1, keepdim=True)
    assert not any("frame rate" in line for line in told(found, joints + hips - hips[:1]))


def test_frames_of_a_longer_truth(joints: Tensor) -> None:
    """Of a clip that was cut; numbers of the truth need not begin with 0, nor be in order."""
    everything = torch.ones(joints[:35].shape[:-1], dtype=torch.bool)
    order = torch.randperm(60, generator=torch.Generator().manual_seed(0))
    (line,) = mismatches(
        joints[18:53],
        joints[:35],
        everything,
        ORDER,
        frames=range(100, 135),
        whole=joints[order],
        whole_frames=(100 + order).tolist(),
    )
    assert "with the truth of 18 frames later 0% of the error is left" in line


def test_a_mirrored_world(joints: Tensor) -> None:
    (line,) = told(joints, joints * torch.tensor([-1.0, 1.0, 1.0]).to(joints))
    assert "in a mirror 0% of the error is left" in line


def test_sides(joints: Tensor) -> None:
    lines = told(joints, joints[:, list(ORDER)])
    assert any("left and right of the truth exchanged" in line for line in lines)


def test_sides_of_a_pose_in_another_world(joints: Tensor) -> None:
    """One view without a calibration: where the person stands says nothing."""
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(1)).to(joints)
    turn = rotvec_to_matrix(torch.tensor([0.2, 2.0, 0.0], dtype=joints.dtype))
    elsewhere = (joints + 0.03 * noise) @ turn.mT + 2.0
    assert not any("left and right" in line for line in told(elsewhere, joints))
    assert any("left and right" in line for line in told(elsewhere, joints[:, list(ORDER)]))


def test_another_world(joints: Tensor) -> None:
    turn = rotvec_to_matrix(torch.tensor([torch.pi / 2, 0, 0]).to(joints))
    (line,) = told(joints, joints @ turn.mT)
    assert "rotation of all frames by 90 degrees" in line


def test_truth_relative_to_the_hips(joints: Tensor) -> None:
    (line,) = told(joints, root_aligned(joints))
    assert "relative to them" in line


@pytest.mark.parametrize("root", ["pelvis", "neck", "trembling hips"])
def test_truth_relative_to_another_place_in_the_body(joints: Tensor, root: str) -> None:
    hips, neck = joints[:, [8, 12]].mean(1), joints[:, 1]
    noise = torch.randn(hips.shape, generator=torch.Generator().manual_seed(0)).to(hips)
    up = torch.nn.functional.normalize(neck - hips, dim=-1)
    place = {"pelvis": hips + 0.09 * up, "neck": neck, "trembling hips": hips + 0.002 * noise}
    moved = joints + torch.linspace(1, 4, 60)[:, None, None].to(joints)
    lines = told(moved, joints - place[root][:, None])
    assert any("relative to a place in the body" in line for line in lines)


def test_whoever_lies_at_the_origin_is_not_relative(joints: Tensor) -> None:
    lying = joints - joints[:1, [8, 12]].mean(1, keepdim=True)
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)
    assert not any("relative" in line for line in told(lying + 0.1 * noise, lying))


def test_another_order(joints: Tensor) -> None:
    (line,) = told(joints, joints.flip(-2))
    assert "order of the landmarks" in line


def test_joints_that_are_missing_take_no_part(joints: Tensor) -> None:
    valid = torch.rand(joints.shape[:-1], generator=torch.Generator().manual_seed(0)) > 0.3
    holes = torch.where(valid.unsqueeze(-1), joints, torch.nan)
    turn = rotvec_to_matrix(torch.tensor([0, 0, torch.pi / 2]).to(joints))
    assert told(joints, holes, valid) == ()
    assert any("rotation" in line for line in told(joints, holes @ turn.mT, valid))
    assert told(joints, holes, torch.zeros_like(valid)) == ()


def test_another_clip_elsewhere_is_no_rotation(joints: Tensor) -> None:
    """Its place is most of the error, which any rigid motion takes away."""
    other = joints.flip(-2) + torch.tensor([0.0, 1.0, 8.0]).to(joints)
    lines = told(joints, other)
    assert lines and not any("rotation" in line or "mirror" in line for line in lines)


def test_another_clip_whose_poses_are_alike(joints: Tensor) -> None:
    """Of one person who waves: only time shows that they are of other motion."""
    joints = joints.mean(0) + 0.7 * (joints - joints.mean(0))
    mixed = joints[torch.arange(60) * 23 % 60]
    aside = torch.tensor([0.06, 0.0, 0.0]).to(joints)
    (line,) = told(mixed + aside, joints)
    assert "change independently of each other" in line and "of this clip and person" in line
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(1)).to(joints)
    assert told(joints + aside + 0.03 * noise, joints) == ()
    assert told((mixed + aside)[:29], joints[:29]) == ()
