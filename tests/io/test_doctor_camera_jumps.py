"""Poses of a moving camera that are of no way, and steps, are named; shakes and speed are not."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from takes import make_take, write_json, write_take
from torch import Tensor

from perfcap.app.capture_checks import doubts
from perfcap.app.inputs import read_inputs
from perfcap.commands.views import Views
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Finding, Severity, examine_cameras, examine_inputs

FRAMES = 90


def rig(turns: Tensor, places: Tensor) -> CameraRig:
    """One view with rotation vectors (F, 3) and centres (F, 3), metres, in the world."""
    still = make_take(3).cameras
    rotation = rotvec_to_matrix(turns.double()) @ still.rotation  # F 3 3
    shift = -(rotation @ (places.double() + still.centre)[..., None])[..., 0]
    lens = still.intrinsics.expand(len(turns), 1, 3, 3)
    camera = Camera(lens, rotation[:, None], shift[:, None], None, still.size)
    return CameraRig(("phone",), camera)


def noise(seed: int, count: int = FRAMES) -> Tensor:
    return torch.randn(count, 3, generator=torch.Generator().manual_seed(seed)).double()


def held(count: int = FRAMES, rate: float = 30.0) -> CameraRig:
    """A camera in a hand that walks: 3 degrees of sway at a step's rate, and trembling."""
    time = torch.arange(count).double()[:, None] / rate
    sway = torch.cat((0.05 * (11 * time).sin(), 0.02 * (7 * time).cos(), 0.3 * time), -1)
    way = torch.cat((0.8 * time, 0.03 * (11 * time).sin(), 0 * time), -1)
    return rig(sway + 0.002 * noise(1, count), way + 0.003 * noise(2, count))


def spoiled(
    good: CameraRig, frames: list[int], rotation: Tensor | None = None, shift: Tensor | None = None
) -> CameraRig:
    """With another rotation, or a place shifted in the camera's axes, in some frames."""
    turned, moved = good.cameras.rotation.clone(), good.cameras.translation.clone()
    if rotation is not None:
        turned[frames] = rotation.double() @ turned[frames]
    if shift is not None:
        moved[frames] += shift.double()
    return replace(good, cameras=replace(good.cameras, rotation=turned, translation=moved))


def unsolved(good: CameraRig, frames: list[int]) -> CameraRig:
    turned, moved = good.cameras.rotation.clone(), good.cameras.translation.clone()
    turned[frames], moved[frames] = torch.eye(3).double(), 0.0
    return replace(good, cameras=replace(good.cameras, rotation=turned, translation=moved))


def one(cameras: CameraRig, first: int = 0) -> Finding:
    (finding,) = examine_cameras(cameras, first=first)
    assert finding.severity is Severity.WARNING and finding.subject == "phone"
    return finding


TEN_DEGREES = rotvec_to_matrix(torch.tensor([0.0, math.radians(10), 0.0]))


@pytest.mark.parametrize("good", [held(), rig(torch.zeros(FRAMES, 3), torch.zeros(FRAMES, 3))])
def test_poses_that_jump_away_and_back(good: CameraRig) -> None:
    assert examine_cameras(good) == []
    turned = one(spoiled(good, [10, 40], TEN_DEGREES))
    assert "jumps away and back in frames 10, 40, by up to" in turned.what
    assert "10." in turned.what and "are usual" in turned.what
    shifted = one(spoiled(good, [10], shift=torch.tensor([0.0, 0.0, 1.0])), first=200)
    assert "in frames 210, by up to" in shifted.what


@pytest.mark.parametrize("frames", [[30], [0], [89], [0, 1, 2], [20, 21, 50], [*range(0, 90, 5)]])
def test_identities_of_images_without_a_pose(frames: list[int]) -> None:
    finding = one(unsolved(held(), frames))
    assert "the identity at the origin in frames" in finding.what
    assert f"frames {frames[0]}" in finding.what and "solve" in finding.remedy


def test_both_at_once_do_not_hide_each_other() -> None:
    lost, slipped = examine_cameras(unsolved(spoiled(held(), [10], TEN_DEGREES), [11]))
    assert "frames 11," in lost.what and "frames 10," in slipped.what


def fast() -> CameraRig:
    """Whips around by 10 degrees a frame, on a dolly that stops at once."""
    time = torch.arange(FRAMES).double()[:, None]
    turn = torch.cat((0 * time, math.radians(40) * torch.sin(time / 4), 0 * time), -1)
    return rig(turn, torch.cat((0.4 * time.clamp(30, 60), 0 * time, 0 * time), -1))


def cut() -> CameraRig:
    """Goes over to another place twice, for more than one frame."""
    places = torch.zeros(FRAMES, 3)
    places[30:33, 0], places[60:, 2] = 3.0, -2.0
    return rig(0.002 * noise(3), places)


def test_steps_that_stay_are_named() -> None:
    """A cut, or ten frames that were solved half a metre aside: the file does not say which."""
    assert "steps by up to 0.5 degrees and 3.00 m before frames 30, 33, 60" in one(cut()).what
    aside = one(spoiled(held(), [*range(40, 50)], shift=torch.tensor([0.5, 0.0, 0.0])), first=5)
    assert "m before frames 45, 55, and" in aside.what and "--frames" in aside.remedy
    assert "before frames 30, 55" in one(stands_at_the_origin_for_a_shot()).what
    turned = one(spoiled(held(), [*range(40, 50)], TEN_DEGREES))
    assert "before frames 40, 50" in turned.what


def sets_off() -> CameraRig:
    """Stands on a tripod, then runs: ten images a second."""
    time = torch.arange(FRAMES).double()[:, None] / 10
    runs = (time > 6).double()
    turn = runs * 0.12 * torch.cat([(k * 17 * time).sin() for k in (1.0, 1.1, 0.9)], -1)
    return rig(turn + 0.0005 * noise(4), 0.001 * noise(5) + 3 * (time - 6).clamp(min=0))


def begins_at_the_origin() -> CameraRig:
    """The first camera is the world, as programs have it that track a camera."""
    good = held()
    turn, place = good.cameras.rotation[:1], good.cameras.centre[0]
    rotation = good.cameras.rotation @ turn.mT
    centres = (turn @ (good.cameras.centre - place)[..., None])[..., 0]
    shift = -(rotation @ centres[..., None])[..., 0]
    return replace(good, cameras=replace(good.cameras, rotation=rotation, translation=shift))


def stands_at_the_origin_for_a_shot() -> CameraRig:
    return unsolved(held(), [*range(30, 55)])


def trembles() -> CameraRig:
    """Poses of a poor solution, each by itself."""
    return rig(0.05 * noise(6, 2000), 0.2 * noise(7, 2000))


def first_frames() -> CameraRig:
    good = spoiled(held(), [1], TEN_DEGREES)  # of three poses, any one may be the odd one
    return replace(good, cameras=good.cameras.frames(slice(0, 3)))


@pytest.mark.parametrize(
    "make",
    [fast, sets_off, begins_at_the_origin, trembles,
     first_frames],
)  # fmt: skip
def test_ways_that_cameras_do_take(make: object) -> None:
    assert examine_cameras(make()) == []  # type: ignore[operator]


def test_a_camera_that_is_the_world_beside_one_that_moves() -> None:
    moving = held().cameras
    still = unsolved(held(), [*range(FRAMES)]).cameras
    both = Camera(
        torch.cat((moving.intrinsics, still.intrinsics), 1),
        torch.cat((moving.rotation, still.rotation), 1),
        torch.cat((moving.translation, still.translation), 1),
        None,
        moving.size + still.size,
    )
    assert examine_cameras(CameraRig(("phone", "tripod"), both)) == []
    assert examine_cameras(replace(held(), cameras=moving.frames(slice(0, 1)))) == []


def test_doctor_and_capture_count_frames_by_the_video(tmp_path: Path) -> None:
    take = write_take(tmp_path, 20, moving=True)
    entry = json.loads(take.camera.read_text())
    assert not [each for each in examine_inputs(take.camera) if "pose" in each.what]
    entry["R"][12], entry["t"][12] = torch.eye(3).tolist(), [0.0, 0.0, 0.0]
    write_json(take.camera, entry)
    (finding,) = examine_inputs(take.camera)
    assert finding.severity is Severity.WARNING and "in frames 12," in finding.what
    files = Views(
        videos=(take.video,), cameras=take.camera, detections=(take.detections,), frames="5:"
    )
    told = doubts(read_inputs(files), needs_images=False, detected=False)
    (lost,) = (each for each in told if "identity at the origin in frames 12," in each.what)
    assert lost.frames == (7,) and lost.views == (0,)  # of the capture
