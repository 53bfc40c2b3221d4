"""Cameras whose numbers are numbers and that cannot be: named by doctor, refused by capture."""

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.cameras import examine_cameras, impossible_cameras
from perfcap.io.doctor.finding import Severity


def rig(views: int = 3, lens: tuple[float, ...] = (-0.1, 0.05, 0.0, 0.0, 0.0)) -> CameraRig:
    cameras = make_take(3, views=views).cameras
    bent = torch.tensor(lens, dtype=torch.float64).expand(views, 5)
    return CameraRig(tuple("abcd"[:views]), replace(cameras, distortion=bent))


def test_plain_cameras() -> None:
    assert impossible_cameras(rig()) == []


@pytest.mark.parametrize(
    "lens", [(5.0, 50.0, 0, 0, 0), (-3.0, 0, 0, 0, 0), (0, 0, 0, 0, 400.0), (0, 0, 1.0, 0, 0)]
)
def test_lenses_that_bend_too_far(lens: tuple[float, ...]) -> None:
    wide = rig(1, lens)
    intrinsics = wide.cameras.intrinsics.clone()
    intrinsics[..., 0, 0] = intrinsics[..., 1, 1] = 400.0  # of 600 px
    wide = replace(wide, cameras=replace(wide.cameras, intrinsics=intrinsics))
    (finding,) = impossible_cameras(wide)
    assert finding.severity is Severity.ERROR and "distortion" in finding.what
    assert finding in examine_cameras(wide)


def test_copies_of_one_camera() -> None:
    good = rig().cameras
    copied = replace(
        good, rotation=good.rotation[[0, 1, 0]], translation=good.translation[[0, 1, 0]]
    )
    (finding,) = impossible_cameras(replace(rig(), cameras=copied))
    assert finding.subject == "a and c" and "same rotation" in finding.what
