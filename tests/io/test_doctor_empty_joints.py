"""3D joints that were not found and have zeros in place of NaN."""

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Finding, Severity, examine_detections
from perfcap.pipeline.pose_refiner import PoseRefiner


def examined(share: float) -> list[Finding]:
    """Warnings of a view in which so many 3D joints are 0, 0, 0."""
    take = make_take(60)
    poses = take.detections.joints3d
    assert poses is not None
    lost = torch.rand(poses.shape[:-1], generator=torch.Generator().manual_seed(0)) < share
    detections = replace(take.detections, joints3d=poses.masked_fill(lost[..., None], 0.0))
    found = examine_detections(CameraRig(("a",), take.cameras), detections, coverage=False)
    return [each for each in found if each.severity is not Severity.INFO]


@pytest.mark.parametrize("share", [0.1, 0.2, 0.5])
def test_zeros_in_place_of_joints_are_named(share: float) -> None:
    (found,) = [each for each in examined(share) if "at one place" in each.what]
    assert found.views == (0,) and "zeros stand for joints" in found.what


def test_whole_poses_are_not() -> None:
    assert not examined(0.0)


def test_a_refiner_names_them() -> None:
    take = make_take(30)
    poses = take.detections.joints3d
    assert poses is not None
    lost = torch.rand(poses.shape[:-1], generator=torch.Generator().manual_seed(0)) < 0.2
    refiner = PoseRefiner(take.actor, rate=take.rate)
    seen = take.detections
    given = seen.joints2d, seen.confidence2d, poses.masked_fill(lost[..., None], 0.0)
    with pytest.warns(UserWarning, match="3D joints are at one place"):
        refiner(take.cameras, *given)
