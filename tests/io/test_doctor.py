"""Views that agree give no findings; where they do not, the culprit is named."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from doctored_views import (
    FRAMES,
    NAMES,
    VIEWS,
    change_view,
    detections,
    one,
    person,
    rig,
    with_joints,
)
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import (
    Severity,
    examine_agreement,
    examine_cameras,
    examine_detections,
)


def test_good_inputs_give_no_findings() -> None:
    good = rig()
    assert examine_cameras(good, [(1000, 1000)] * VIEWS) == []
    assert examine_detections(good, detections()) == []
    assert examine_agreement(good, detections()) == []
    assert examine_agreement(good, detections(noise=0)) == []


def test_one_file_for_two_views_is_named() -> None:
    finding = one(examine_detections(rig(), detections().select([*range(VIEWS - 1), 0])))
    assert finding.subject == f"{NAMES[0]} and {NAMES[VIEWS - 1]}"
    assert "same joints to the last digit" in finding.what


@pytest.mark.long
@pytest.mark.parametrize("view", range(VIEWS))
@pytest.mark.parametrize("degrees", [8, 30])
def test_a_turned_camera_is_named(view: int, degrees: float) -> None:
    good = rig()
    turn = rotvec_to_matrix(torch.tensor([0.3, np.deg2rad(degrees), 0.0], dtype=torch.float64))
    broken = change_view(good, view, rotation=turn @ good.cameras.rotation[view])
    finding = one(examine_agreement(broken, detections()))
    assert finding.subject == NAMES[view] and "from where the other views see them" in finding.what


def test_a_wrong_focal_length_is_named() -> None:
    k = rig().cameras.intrinsics[1].clone()
    k[:2, :2] *= 1.3
    assert (
        one(examine_agreement(change_view(rig(), 1, intrinsics=k), detections())).subject == "cam2"
    )


@pytest.mark.long
def test_two_bad_cameras_of_six() -> None:
    good = rig()
    both = [0, 1, 2, 3, 0, 1]
    six = CameraRig(tuple(f"c{i}" for i in range(6)), good.cameras.select(both))
    offset = rotvec_to_matrix(torch.tensor([0.0, 0.4, 0.0], dtype=torch.float64))
    for view in (4, 5):  # the repeated views stand elsewhere
        six = change_view(six, view, rotation=six.cameras.rotation[view] @ offset)
    seen = detections(six)
    turn = rotvec_to_matrix(torch.tensor([0.2, 0.3, 0.0], dtype=torch.float64))
    for view in (1, 5):
        six = change_view(six, view, rotation=turn @ six.cameras.rotation[view])
    assert {finding.subject for finding in examine_agreement(six, seen)} == {"c1", "c5"}


def test_camera_to_world_is_recognised() -> None:
    camera = rig().cameras
    inverse = replace(camera, rotation=camera.rotation.mT, translation=camera.centre)
    finding = one(examine_agreement(replace(rig(), cameras=inverse), detections()))
    assert finding.subject == "cameras" and "camera-to-world" in finding.what


@pytest.mark.long
def test_half_of_an_inverse_is_recognised() -> None:
    upright = rig().cameras  # cameras that turn about one axis alone fit mirrored, too
    world = rotvec_to_matrix(torch.tensor([0.5, 0.3, 0.9], dtype=torch.float64))
    camera = replace(upright, rotation=upright.rotation @ world)
    placed = replace(camera, translation=camera.centre)
    finding = one(examine_agreement(replace(rig(), cameras=placed), detections()))
    assert "t were the place of the camera" in finding.what and "t = -R place" in finding.remedy
    turned = replace(camera, rotation=camera.rotation.mT)
    finding = one(examine_agreement(replace(rig(), cameras=turned), detections()))
    assert "R alone were transposed" in finding.what


def test_opengl_axes_are_recognised() -> None:
    camera = rig().cameras
    flip = torch.diag(torch.tensor([1.0, -1, -1])).double()
    flipped = replace(
        camera, rotation=flip @ camera.rotation, translation=camera.translation @ flip
    )
    assert "OpenGL" in one(examine_agreement(replace(rig(), cameras=flipped), detections())).what


def test_swapped_sides_are_named() -> None:
    mirror = [
        LANDMARKS.index({"l": "r", "r": "l"}[n[0]] + n[1:]) if n[1] == "_" else i
        for i, n in enumerate(LANDMARKS)
    ]

    def swap(joints: Tensor) -> None:
        joints[:, 2] = joints[:, 2][:, mirror]

    finding = one(examine_agreement(rig(), with_joints(detections(), swap)))
    assert finding.subject == "cam3" and "left and right" in finding.what


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ("", "the feet point backwards"),
        ("hip knee ankle toe", "left and right of the legs"),
        ("shoulder elbow wrist", "left and right of the arms"),
    ],
)
@pytest.mark.parametrize("space", [False, True])
def test_sides_exchanged_in_every_view(joints: str, words: str, space: bool) -> None:
    """Rays cross as well as before."""
    names = joints.split() or [name[2:] for name in LANDMARKS if name[1] == "_"]
    order = [
        LANDMARKS.index(f"{'rl'['lr'.index(name[0])]}{name[1:]}") if name[2:] in names else place
        for place, name in enumerate(LANDMARKS)
    ]
    seen = detections()
    if space:  # one view with 3D poses
        local = rig().cameras.to_camera(person())[:, :1]
        hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
        seen = replace(
            seen.select([0]),
            joints3d=local - local[..., hips, :].mean(-2, keepdim=True),
            trusted3d=torch.ones(FRAMES, 1, dtype=torch.bool),
        )
        views = CameraRig(NAMES[:1], rig().cameras.select([0]))
        assert examine_detections(views, seen) == []
        assert seen.joints3d is not None
        seen = replace(seen, joints2d=seen.joints2d[..., order, :])
        seen = replace(
            seen, joints3d=None if seen.joints3d is None else seen.joints3d[..., order, :]
        )
        finding = one(examine_detections(views, seen))
    else:
        finding = one(
            examine_agreement(rig(), replace(seen, joints2d=seen.joints2d[..., order, :]))
        )
        assert finding.subject == "detections"
    assert finding.severity is Severity.ERROR and words in finding.what


def test_exchanged_views_are_named() -> None:
    finding = one(examine_agreement(rig(), detections().select([0, 3, 2, 1])))
    assert finding.subject == "cam2 and cam4" and "exchanged" in finding.what


def test_a_late_view_is_named() -> None:
    def delay(joints: Tensor) -> None:
        joints[5:, 0] = joints[:-5, 0].clone()

    finding = one(examine_agreement(rig(), with_joints(detections(), delay)))
    assert finding.subject == "cam1" and "5 or so frames late" in finding.what


@pytest.mark.long
def test_other_image_sizes_are_named() -> None:
    half = detections()
    finding = one(examine_agreement(rig(), replace(half, joints2d=half.joints2d / 2)))
    assert finding.subject == "detections" and "0.5 times" in finding.what

    def double(joints: Tensor) -> None:
        joints[:, 1] *= 2

    finding = one(examine_agreement(rig(), with_joints(half, double)))
    assert finding.subject == "cam2" and "image 2 times" in finding.what


@pytest.mark.long
def test_units() -> None:
    good = rig()
    translation = good.cameras.translation[1] * 1000
    finding = one(examine_agreement(change_view(good, 1, translation=translation), detections()))
    assert finding.subject == "cam2" and "millimetres" in finding.what
    all_mm = replace(good.cameras, translation=good.cameras.translation * 1000)
    mm = replace(good, cameras=all_mm)
    assert "apart, which looks like millimetres" in one(examine_cameras(mm)).what
    assert "legs measure" in one(examine_agreement(mm, detections())).what
    small = replace(good, cameras=replace(good.cameras, translation=good.cameras.translation / 4))
    assert "another unit" in one(examine_agreement(small, detections())).what
    single = mm.select([0])
    assert "translation is 4123 m long" in one(examine_cameras(single)).what


def test_nothing_fits() -> None:
    pixels = detections().joints2d
    random = torch.rand(pixels.shape, generator=torch.Generator().manual_seed(1)).to(pixels) * 1000
    findings = examine_agreement(rig(), replace(detections(), joints2d=random))
    assert findings[-1].subject == "cameras" and "disagree on the person" in findings[-1].what


def test_two_views_disagree_without_a_culprit() -> None:
    nod = rotvec_to_matrix(torch.tensor([0.2, 0.0, 0.0], dtype=torch.float64))
    two = rig().select([0, 1])
    camera = two.cameras
    broken = change_view(
        two, 0, rotation=nod @ camera.rotation[0], translation=nod @ camera.translation[0]
    )
    finding = one(examine_agreement(broken, detections().select([0, 1])))
    assert finding.subject == "cameras" and "disagree" in finding.what
    assert examine_agreement(two, detections().select([0, 1])) == []


def test_a_person_behind_the_cameras() -> None:
    """A single wrong axis pair that no convention has."""
    turn = torch.tensor([-1.0, 1, -1]).double()
    camera = rig().cameras
    away = replace(
        camera, rotation=turn[:, None] * camera.rotation, translation=turn * camera.translation
    )
    findings = examine_agreement(replace(rig(), cameras=away), detections())
    assert findings and all(finding.severity is Severity.ERROR for finding in findings)


def test_moving_cameras() -> None:
    camera = rig().cameras
    rise = torch.arange(FRAMES)[:, None, None] * torch.tensor([0.0, 0.02, 0]).double()
    moving = Camera(
        camera.intrinsics.expand(FRAMES, VIEWS, 3, 3),
        camera.rotation.expand(FRAMES, VIEWS, 3, 3),
        camera.translation + rise,
        None,
        camera.size,
    )
    moved = replace(rig(), cameras=moving)
    assert examine_cameras(moved) == []
    assert examine_agreement(moved, detections(moved)) == []
    assert one(examine_agreement(moved, detections(moved).select([0, 3, 2, 1])))
    short = detections(moved).frames(slice(0, 20))
    assert examine_agreement(moved, short) == []
    assert "24 camera poses for 20 frames" in one(examine_detections(moved, short)).what


def test_views_that_never_see_the_same() -> None:
    confidence = torch.zeros(FRAMES, VIEWS, 16).double()
    for share in (0.0, 0.9):
        confidence[:, 0] = share
        finding = one(examine_agreement(rig(), replace(detections(), confidence2d=confidence)))
        assert "cannot be checked" in finding.what
