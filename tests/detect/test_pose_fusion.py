"""3D poses of a lifter and of a network that sees the image, as one."""

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.pose_fusion import fuse_poses
from perfcap.geometry.rotation import rotvec_to_matrix

F64 = torch.float64


def poses(seed: int, shift: float = 0.0) -> Tensor:
    """Poses (5, 2, 16, 3) about their root, some of them moved at random."""
    random = torch.Generator().manual_seed(0)
    base = 0.4 * torch.randn(5, 2, 16, 3, generator=random, dtype=F64)
    moved = torch.randn(base.shape, generator=torch.Generator().manual_seed(seed), dtype=F64)
    return base + shift * moved


def detections(joints3d: Tensor | None) -> Detections:
    seen = torch.ones(5, 2, 16, dtype=F64)
    return Detections.from_joints(torch.zeros(5, 2, 16, 2, dtype=F64), seen, joints3d)


def test_poses_that_agree_meet() -> None:
    first, other = poses(1), poses(2, 0.02)
    fused = fuse_poses(detections(first), detections(other)).joints3d
    assert fused is not None
    before, after = (x.norm(dim=-1).mean() for x in (other - first, other - fused))
    assert 0.6 * before < after < 0.75 * before


def test_size_and_heading_of_the_other_do_not_matter() -> None:
    first, other = detections(poses(1)), poses(2, 0.02)
    expected = fuse_poses(first, detections(other)).joints3d
    turns = rotvec_to_matrix(torch.randn(5, 2, 3, dtype=F64))
    sizes = torch.tensor([0.3, 2.0], dtype=F64)[:, None, None]
    found = fuse_poses(first, detections(sizes * (other @ turns.mT))).joints3d
    torch.testing.assert_close(found, expected)


def test_poses_that_contradict_are_left_alone() -> None:
    first, other = poses(1), poses(2)
    other[3] = poses(3, 0.8)[3]
    fused = fuse_poses(detections(first), detections(other)).joints3d
    assert fused is not None
    assert (fused[3] - first[3]).norm(dim=-1).max() < 0.02


def test_only_frames_of_both_change() -> None:
    first, other = detections(poses(1)), detections(poses(2, 0.05))
    other.trusted3d[2] = False
    first.trusted3d[4, 1] = False
    moved = fuse_poses(first, other)
    assert moved.joints3d is not None and first.joints3d is not None
    changed = (moved.joints3d != first.joints3d).flatten(-2).any(-1)
    assert (changed == (first.trusted3d & other.trusted3d)).all()
    assert (moved.trusted3d == first.trusted3d).all()


def test_without_other_poses_nothing_changes() -> None:
    first = detections(poses(1))
    assert fuse_poses(first, detections(None)) is first
    assert fuse_poses(detections(None), first).joints3d is None
    nobody = replace(first, trusted3d=torch.zeros_like(first.trusted3d))
    assert torch.equal(fuse_poses(first, nobody).joints3d, first.joints3d)  # type: ignore[arg-type]


def test_poses_that_contradict_are_expected_to_be_far_off() -> None:
    first, other = poses(1), poses(2, 0.002)
    other[3] = poses(3, 0.8)[3]
    said = torch.full((5, 2), 0.05, dtype=F64)
    said[4] = 0.1
    given = replace(detections(first), deviation3d=said)
    found = fuse_poses(given, detections(other)).deviation3d
    alone = fuse_poses(given, None).deviation3d
    assert found is not None and alone is not None
    for errors in (found, alone):  # of people, in metres
        assert errors.min() > 0.005 and errors.max() < 1.0
    assert found[3].min() > 3 * found[:3].max()
    assert found[4].min() > 1.5 * found[:3].max()
    assert (found[:3] < alone[:3]).all() and alone[4].min() > 2 * alone[0].max()
    blind = detections(other)
    blind.trusted3d[2] = False
    partly = fuse_poses(given, blind).deviation3d
    assert partly is not None
    torch.testing.assert_close(partly[2], alone[2])
    assert fuse_poses(detections(first), detections(other)).deviation3d is None


def test_a_network_whose_error_was_measured_gets_its_share() -> None:
    first, other = poses(1), poses(2, 0.02)
    spread = torch.full((5, 2), 0.08, dtype=F64)
    lifted = replace(detections(first), deviation3d=spread)
    plain = fuse_poses(lifted, detections(other)).joints3d
    distances = []
    for error in (0.5, 0.05, 0.005):
        measured = replace(detections(other), deviation3d=torch.full((5, 2), error))
        fused = fuse_poses(lifted, measured).joints3d
        assert fused is not None and plain is not None
        distances.append(float((fused - other).norm(dim=-1).mean()))
    assert distances[0] > float((plain - other).norm(dim=-1).mean()) > distances[1] > distances[2]
    unknown = replace(detections(other), deviation3d=torch.full((5, 2), torch.nan))
    torch.testing.assert_close(fuse_poses(lifted, unknown).joints3d, plain)
