"""Inputs that are fine give no findings; every mistake is named with its culprit."""

import importlib.metadata
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.detections import read_detections
from perfcap.io.doctor import (
    Finding,
    Severity,
    examine_agreement,
    examine_cameras,
    examine_detections,
    examine_inputs,
    examine_installation,
)
from perfcap.io.doctor.finding import ranges

DATA = Path(__file__).parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data beside this tree")

FRAMES, VIEWS = 24, 4
NAMES = tuple(f"cam{view + 1}" for view in range(VIEWS))


def person() -> Tensor:
    """A walking, turning person (F, 16, 3), metres, y up, standing about the origin."""
    x = {"shoulder": 0.18, "elbow": 0.25, "wrist": 0.3, "hip": 0.1, "knee": 0.12, "ankle": 0.1}
    y = {"head_top": 1.7, "neck": 1.45, "shoulder": 1.4, "elbow": 1.15, "wrist": 0.95}
    y |= {"hip": 0.92, "knee": 0.5, "ankle": 0.08, "toe": 0.02}
    swing = {"elbow": 0.1, "wrist": 0.3, "knee": 0.15, "ankle": 0.25, "toe": 0.3}
    rest, sway = [], []
    for name in LANDMARKS:
        side, _, part = name.partition("_") if name[1] == "_" else ("", "", name)
        sign = {"r": -1.0, "l": 1.0, "": 0.0}[side]
        rest.append((sign * x.get(part, 0.11), y[part], 0.15 if part == "toe" else 0.0))
        sway.append((0.0, 0.0, sign * swing.get(part, 0.0)))
    time = torch.arange(FRAMES, dtype=torch.float64)[:, None, None] / 6
    pose = torch.tensor(rest).double() + torch.tensor(sway).double() * torch.sin(time)
    turn = rotvec_to_matrix(torch.cat((0 * time, 0.3 * time, 0 * time), -1)[:, 0])
    return pose @ turn.mT + torch.tensor([0.3, 0, 0.1]).double() * torch.cos(time)


def rig() -> CameraRig:
    """Four cameras around the person, 4 m away and 1 m high."""
    yaw = torch.tensor([0.0, 1.1, 2.5, 4.0], dtype=torch.float64)
    down = torch.diag(torch.tensor([1.0, -1.0, -1.0])).double()  # world y up to camera y down
    rotation = down @ rotvec_to_matrix(torch.stack((0 * yaw, yaw, 0 * yaw), -1))
    centre_offset = torch.tensor([0.0, 1.0, 4.0], dtype=torch.float64).expand(VIEWS, 3)
    k = torch.tensor([[1000.0, 0, 500], [0, 1000, 480], [0, 0, 1]], dtype=torch.float64)
    size = ((1000, 1000),) * VIEWS
    return CameraRig(NAMES, Camera(k.expand(VIEWS, 3, 3), rotation, centre_offset, None, size))


def detections(cameras: CameraRig | None = None, noise: float = 4.0) -> Detections:
    pixels = (cameras or rig()).cameras.project(person())
    generator = torch.Generator().manual_seed(0)
    jitter = noise * torch.randn(pixels.shape, generator=generator, dtype=pixels.dtype)
    return Detections.from_joints(pixels + jitter, torch.full(pixels.shape[:-1], 0.9).double())


def change_view(good: CameraRig, view: int, **change: Tensor) -> CameraRig:
    fields = {}
    for name, value in change.items():
        field = getattr(good.cameras, name).clone()
        field[view] = value
        fields[name] = field
    return replace(good, cameras=replace(good.cameras, **fields))


def with_joints(good: Detections, change: Any) -> Detections:
    joints = good.joints2d.clone()
    change(joints)
    return replace(good, joints2d=joints)


def one(findings: list[Finding]) -> Finding:
    assert len(findings) == 1, [str(finding) for finding in findings]
    return findings[0]


# --- agreement ----------------------------------------------------------------------------------


def test_good_inputs_give_no_findings() -> None:
    good = rig()
    assert examine_cameras(good, [(1000, 1000)] * VIEWS) == []
    assert examine_detections(good, detections()) == []
    assert examine_agreement(good, detections()) == []
    assert examine_agreement(good, detections(noise=0)) == []


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


def test_exchanged_views_are_named() -> None:
    finding = one(examine_agreement(rig(), detections().select([0, 3, 2, 1])))
    assert finding.subject == "cam2 and cam4" and "exchanged" in finding.what


def test_a_late_view_is_named() -> None:
    def delay(joints: Tensor) -> None:
        joints[5:, 0] = joints[:-5, 0].clone()

    finding = one(examine_agreement(rig(), with_joints(detections(), delay)))
    assert finding.subject == "cam1" and "5 or so frames late" in finding.what


def test_other_image_sizes_are_named() -> None:
    half = detections()
    finding = one(examine_agreement(rig(), replace(half, joints2d=half.joints2d / 2)))
    assert finding.subject == "detections" and "0.5 times" in finding.what

    def double(joints: Tensor) -> None:
        joints[:, 1] *= 2

    finding = one(examine_agreement(rig(), with_joints(half, double)))
    assert finding.subject == "cam2" and "image 2 times" in finding.what


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


# --- cameras ------------------------------------------------------------------------------------


def test_image_sizes() -> None:
    sizes = [(1000, 1000), (500, 500), (1000, 1000), (1000, 1000)]
    finding = one(examine_cameras(rig(), sizes))
    assert (
        finding.subject == "cam2" and "500x500" in finding.what and "--video-map" in finding.remedy
    )
    half = torch.diag(torch.tensor([2.0, 2, 1])).double()
    assert examine_cameras(rig(), sizes, {"cam2": half}) == []
    assert "3 videos for 4 cameras" in one(examine_cameras(rig(), sizes[:3])).what


def test_lenses() -> None:
    k = torch.tensor([[8.0, 0, 500], [0, 8, 500], [0, 0, 1]], dtype=torch.float64)
    assert "field of view" in one(examine_cameras(change_view(rig(), 3, intrinsics=k))).what
    k = torch.tensor([[1000.0, 0, 960], [0, 1000, 540], [0, 0, 1]], dtype=torch.float64)
    assert "principal point" in one(examine_cameras(change_view(rig(), 3, intrinsics=k))).what


def test_cameras_in_one_place() -> None:
    same = rig().select([0, 1, 1, 3])
    finding = one(examine_cameras(replace(same, names=NAMES)))
    assert finding.subject == "cam2 and cam3" and "same place" in finding.what


# --- detections ---------------------------------------------------------------------------------


def test_frames_without_anybody() -> None:
    seen = detections()
    confidence = seen.confidence2d.clone()
    confidence[3:8, 1] = 0
    confidence[12, 1] = 0
    confidence[:, 2] = 0
    first, second = examine_detections(rig(), replace(seen, confidence2d=confidence))
    assert first.subject == "cam2" and "6 of 24 frames: 3-7, 12" in first.what
    assert second.subject == "cam3" and "any frame" in second.what


@pytest.mark.parametrize(
    ("factor", "words"),
    [(3.0, "most joints"), (1 / 1000, "normalised"), (0.45, "top left quarter")],
)
def test_joints_and_image(factor: float, words: str) -> None:
    def scale(joints: Tensor) -> None:
        joints[:, 0] *= factor

    finding = one(examine_detections(rig(), with_joints(detections(), scale)))
    assert finding.subject == "cam1" and words in finding.what


def test_some_joints_outside() -> None:
    def shift(joints: Tensor) -> None:
        joints[:6, 0] += 900

    finding = one(examine_detections(rig(), with_joints(detections(), shift)))
    assert finding.severity is Severity.WARNING and "25% of the joints" in finding.what


def pose3d() -> Tensor:
    """The person in camera axes about the mid-hip, (F, C, 16, 3)."""
    local = rig().cameras.to_camera(person())
    hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
    return local - local[..., hips, :].mean(-2, keepdim=True)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p * 1000, "3D poses span"),
        (lambda p: p + 2, "from the origin"),
        (lambda p: p * torch.tensor([1.0, -1, 1]), "3D y runs against"),
        (lambda p: p * torch.tensor([-1.0, 1, 1]), "3D x runs against"),
    ],
)
def test_3d_poses(change: Any, words: str) -> None:
    seen = detections()
    trusted = torch.ones(FRAMES, VIEWS, dtype=torch.bool)
    good = replace(seen, joints3d=pose3d(), trusted3d=trusted)
    assert examine_detections(rig(), good) == []
    bad = replace(good, joints3d=change(pose3d()))
    findings = examine_detections(rig(), bad)
    assert [finding.subject for finding in findings] == list(NAMES)
    assert all(words in finding.what for finding in findings)


def test_wrong_number_of_views() -> None:
    finding = one(examine_detections(rig(), detections().select([0, 1])))
    assert "2 views for 4 cameras" in finding.what


def test_ranges() -> None:
    assert ranges([1, 2, 3, 7, 9, 10]) == "1-3, 7, 9-10"
    assert ranges(range(0, 40, 2), 2) == "0, 2 and 18 more ranges"


# --- files --------------------------------------------------------------------------------------


def test_unreadable_files_become_findings(tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text("{")
    finding = one(examine_inputs(tmp_path / "camera.json"))
    assert finding.severity is Severity.ERROR and "not valid JSON" in finding.what
    assert finding.subject.endswith("camera.json") and finding.remedy


def test_unknown_joint_names_become_a_finding(tmp_path: Path) -> None:
    k = rig().cameras.intrinsics[0].tolist()
    camera = {"K": k, "R": torch.eye(3).tolist(), "t": [0, 0, 4], "width": 1000, "height": 1000}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    np.savez(
        tmp_path / "d.npz",
        joints2d=np.ones((3, 2, 2)),
        confidence2d=np.ones((3, 2)),
        joint_names=np.array(["neck", "antenna"]),
    )
    finding = one(examine_inputs(tmp_path / "camera.json", [tmp_path / "d.npz"]))
    assert "unknown antenna" in finding.what


@needs_data
def test_real_views_are_quiet_with_their_video_map() -> None:
    base = DATA / "pose2sim_balancing"
    findings = examine_inputs(
        base / "calibration/Calib_scene.toml",
        sorted((base / "pose2d_associated").iterdir()),
        sorted((base / "videos").iterdir()),
        base / "video_to_native.json",
    )
    assert not [str(f) for f in findings if f.severity is Severity.ERROR]
    warnings = [str(f) for f in findings if f.severity is Severity.WARNING]
    assert len(warnings) == 1 and "the first 60 are used" in warnings[0]


def balancing(calibration: str) -> tuple[CameraRig, Detections]:
    base = DATA / "pose2sim_balancing"
    real = read_cameras(base / "calibration" / calibration)
    paths = sorted((base / "pose2d_associated").iterdir())
    return real, read_detections(paths, views=len(real.names))[0]


@needs_data
def test_real_views_with_one_broken() -> None:
    real, seen = balancing("Calib_scene.toml")
    turn = rotvec_to_matrix(torch.tensor([0.0, np.deg2rad(5), 0.0], dtype=torch.float64))
    broken = change_view(real, 1, rotation=turn @ real.cameras.rotation[1])
    assert one(examine_agreement(broken, seen)).subject == "int_cam02_img"


@needs_data
def test_the_worse_of_two_real_calibrations_is_called_so() -> None:
    real, seen = balancing("Calib_qualisys.toml")
    finding = one(examine_agreement(real, seen))
    assert finding.subject == "cam_03" and finding.severity is Severity.WARNING


@needs_data
@pytest.mark.parametrize("sequence", ["dev_views", "dev_duo"])
def test_rendered_views_are_quiet(sequence: str) -> None:
    folder = DATA / "rendered_multi" / sequence
    findings = examine_inputs(folder / "cameras.json", [folder / "person1/detections.npz"])
    assert findings == []


@needs_data
@pytest.mark.parametrize("sequence", ["dev_tight", "dev_skirt"])
def test_rendered_single_views_are_quiet(sequence: str) -> None:
    folder = DATA / "rendered" / sequence
    assert (
        examine_inputs(folder / "camera.json", [folder / "detections.npz"], [folder / "video.mp4"])
        == []
    )


# --- installation -------------------------------------------------------------------------------


def test_rival_distributions_are_found() -> None:
    installed = {"opencv-python": "4.1", "opencv-python-headless": "5.0", "onnxruntime-gpu": "1.3"}

    def version(name: str) -> str | None:
        absent = name == "trimesh" or name.startswith(("opencv", "onnxruntime"))
        return installed.get(name, None if absent else "1.0")

    findings = {finding.subject: finding for finding in examine_installation(version)}
    assert "overwrite each other" in findings["cv2"].what
    assert "onnxruntime" not in findings  # the GPU distribution stands in for it
    assert findings["trimesh"].severity is Severity.ERROR
    assert findings["torch"].what == "1.0"


def test_this_installation() -> None:
    findings = examine_installation()
    torch_finding = next(finding for finding in findings if finding.subject == "torch")
    assert torch_finding.what == importlib.metadata.version("torch")
    assert str(torch_finding).startswith("info: torch: ")
