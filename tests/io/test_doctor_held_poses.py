"""Poses of a moving camera that stay for a few frames at a time."""

from dataclasses import replace

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_cameras

FRAMES = 40


def said(index: Tensor) -> list[str]:
    """Of a camera that moves, with the poses of these frames."""
    cameras = make_take(FRAMES, views=2, moving=True).cameras
    held = cameras.frames(index)
    rotation, translation = cameras.rotation.clone(), cameras.translation.clone()
    rotation[:, 0], translation[:, 0] = held.rotation[:, 0], held.translation[:, 0]
    rig = CameraRig(("a", "b"), replace(cameras, rotation=rotation, translation=translation))
    return [
        f"{each.subject} {each.what}"
        for each in examine_cameras(rig)
        if each.severity is Severity.WARNING
    ]


@pytest.mark.parametrize("step", [2, 4, 10])
def test_each_nth_pose_is_named(step: int) -> None:
    (what,) = said(torch.arange(FRAMES) // step * step)
    assert what.startswith("a its pose stays the same to the last digit")
    assert f"for {step} frames at a time (in {FRAMES - FRAMES // step} of 40)" in what


def test_poses_of_every_frame_are_not() -> None:
    assert said(torch.arange(FRAMES)) == []


def test_nor_is_a_camera_that_rests() -> None:
    assert said(torch.zeros(FRAMES, dtype=torch.long)) == []
    now_and_then = (torch.arange(FRAMES) - 15).clamp(min=0)
    assert said(now_and_then) == []
    twice = torch.cat((torch.zeros(12), torch.arange(12), torch.full((16,), 11))).long()
    assert said(twice) == []
