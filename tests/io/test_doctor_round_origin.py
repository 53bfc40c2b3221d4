"""Translations of a camera that turns which stay as they are."""

from dataclasses import replace

import pytest
import torch
from takes import Take, make_take
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_cameras
from perfcap.pipeline import capture

FRAMES = 40


def pan(degrees: float = 6.0, frames: int = FRAMES) -> CameraRig:
    """One view on a tripod, which turns there and back."""
    cameras = make_take(frames, moving=True).cameras
    still = cameras.map(lambda part: part[:1])
    yaw = torch.deg2rad(torch.tensor(degrees)) * (torch.arange(frames) / 12).sin()
    turn = rotvec_to_matrix(torch.stack((0 * yaw, yaw, 0 * yaw), -1).double())[:, None]
    rotation = turn @ still.rotation
    shift = -(rotation @ still.centre[..., None])[..., 0]
    lens = still.intrinsics.expand(frames, 1, 3, 3)
    moved = replace(cameras, rotation=rotation, translation=shift, intrinsics=lens)
    return CameraRig(("tripod",), moved)


def said(rig: CameraRig) -> list[str]:
    return [each.what for each in examine_cameras(rig) if each.severity is Severity.WARNING]


def with_translation(rig: CameraRig, shift: Tensor) -> CameraRig:
    every = shift.expand_as(rig.cameras.translation)
    return replace(rig, cameras=replace(rig.cameras, translation=every))


def test_a_tripod_has_translations_that_change() -> None:
    assert said(pan()) == []


@pytest.mark.parametrize("which", ["of the first frame", "centre"])
def test_one_translation_is_named(which: str) -> None:
    rig = pan()
    cameras = rig.cameras
    shift = cameras.centre[:1] if which == "centre" else cameras.translation[:1]
    (what,) = said(with_translation(rig, shift))
    assert "the same in every frame while it turns by 6" in what and "world's origin" in what


def test_who_looks_at_the_origin_goes_round_it() -> None:
    shift = torch.tensor([0.01, -0.02, 5.0]).double()
    assert said(with_translation(pan(), shift)) == []


def test_what_hardly_turns_or_stands_at_the_origin_is_let_be() -> None:
    rig = pan(0.2)
    assert said(with_translation(rig, rig.cameras.translation[:1])) == []
    assert said(with_translation(pan(), torch.zeros(1, 1, 3).double())) == []
    still = pan(0.0)
    assert said(still) == []


@pytest.mark.long
def test_a_capture_says_so() -> None:
    take, right = make_take(FRAMES), pan().cameras
    pixels = right.project(take.actor.joints(take.truth))
    seen = replace(take.detections, joints2d=pixels)
    wrong = with_translation(pan(), right.translation[:1]).cameras
    assert not any("same in every" in line for line in move(take, right, seen))
    assert any("same in every frame" in line for line in move(take, wrong, seen))


def move(take: Take, cameras: Camera, seen: Detections) -> tuple[str, ...]:
    return capture(take.actor, cameras, seen, take.rate).warnings
