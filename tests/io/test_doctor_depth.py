"""Depth of 3D poses in another unit than their width and height."""

import pytest
import torch
from takes import make_take

import perfcap
from perfcap.io import models_folder
from perfcap.io.doctor.depth import examine_depth
from perfcap.pipeline.input_doubts import input_doubts

DEMO = models_folder() / "demo"
SEEN = perfcap.read_detections([DEMO / "detections.npz"])[0]


@pytest.mark.parametrize("factor", [0.3, 0.5, 2.0, 3.0])
def test_depth_in_another_unit_is_named(factor: float) -> None:
    assert SEEN.joints3d is not None
    poses = SEEN.joints3d[:, 0]
    assert examine_depth("a", poses) == []
    (found,) = examine_depth("a", poses * poses.new_tensor([1, 1, factor]))
    assert "bones of the 3D poses would keep their lengths" in found.what
    assert float(found.what.split()[1]) == pytest.approx(1 / factor, rel=0.2)


def test_poses_without_depth_are_named() -> None:
    """As 2D joints with a third column of zeros are."""
    assert SEEN.joints3d is not None
    flat = SEEN.joints3d * SEEN.joints3d.new_tensor([1, 1, 0])
    rig = perfcap.read_cameras(DEMO / "camera.json")
    told = input_doubts(rig.cameras, type(SEEN).from_joints(SEEN.joints2d, SEEN.confidence2d, flat))
    assert any("3D poses are flat: from end to end they span" in line for line in told)


def test_who_stands_still_says_nothing() -> None:
    """And few poses."""
    poses = make_take(20).detections.joints3d
    assert poses is not None
    noise = torch.randn(poses[:, 0].shape, generator=torch.Generator().manual_seed(0)).to(poses)
    still = poses[:1, 0] + 0.03 * noise
    for case in (poses[:, 0], still, (poses[:, 0] * poses.new_tensor([1, 1, 3]))[:9]):
        assert examine_depth("a", case) == []
