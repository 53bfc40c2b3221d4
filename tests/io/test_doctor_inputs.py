"""Cameras, detections, files and installations by themselves: every mistake is named."""

import importlib.metadata
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

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

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.detections import read_detections
from perfcap.io.doctor import (
    Severity,
    examine_agreement,
    examine_cameras,
    examine_detections,
    examine_inputs,
    examine_installation,
    examine_places,
)
from perfcap.io.doctor.finding import ranges

DATA = Path(__file__).parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data beside this tree")


# --- cameras ------------------------------------------------------------------------------------


def test_image_sizes() -> None:
    sizes = [(1000, 1000), (500, 500), (1000, 1000), (1000, 1000)]
    finding = one(examine_cameras(rig(), sizes))
    assert (
        finding.subject == "cam2" and "500x500" in finding.what and "--video-map" in finding.remedy
    )
    half = torch.diag(torch.tensor([2.0, 2, 1])).double()
    assert examine_cameras(rig(), sizes, {"cam2": half}) == []
    few = one(examine_cameras(rig(), sizes[:3]))
    assert "3 videos for 4 cameras" in few.what and "COLMAP" not in few.remedy
    fixed = rig().cameras
    way = Camera(
        *(
            each[None, :1].repeat(5, *[1] * each.ndim)
            for each in (fixed.intrinsics, fixed.rotation, fixed.translation)
        ),
        None,
        fixed.size[:1],
    )
    moving = one(examine_cameras(CameraRig(("camera",), way), sizes))
    assert "4 videos for 1 cameras" in moving.what and "images of several" in moving.remedy


def test_lenses() -> None:
    k = torch.tensor([[8.0, 0, 500], [0, 8, 500], [0, 0, 1]], dtype=torch.float64)
    assert "field of view" in one(examine_cameras(change_view(rig(), 3, intrinsics=k))).what
    k = torch.tensor([[1000.0, 0, 960], [0, 1000, 540], [0, 0, 1]], dtype=torch.float64)
    assert "principal point" in one(examine_cameras(change_view(rig(), 3, intrinsics=k))).what


def test_calibrations_of_another_size() -> None:
    """Of half the size, or stretched, where a file does not say its size."""
    half = torch.tensor([[500.0, 0, 250], [0, 500, 250], [0, 0, 1]], dtype=torch.float64)
    assert "principal point" in one(examine_cameras(change_view(rig(), 3, intrinsics=half))).what
    wide = torch.tensor([[1333.0, 0, 500], [0, 1000, 500], [0, 0, 1]], dtype=torch.float64)
    finding = one(examine_cameras(change_view(rig(), 3, intrinsics=wide)))
    assert "1333 px across and 1000 px down" in finding.what and "stretched" in finding.remedy
    real = torch.tensor([[1010.0, 0, 540], [0, 1000, 480], [0, 0, 1]], dtype=torch.float64)
    assert examine_cameras(change_view(rig(), 3, intrinsics=real)) == []


def test_cameras_in_one_place() -> None:
    same = rig().select([0, 1, 1, 3])
    found = examine_cameras(replace(same, names=NAMES))
    assert {finding.subject for finding in found} == {"cam2 and cam3"}
    assert [word for word in ("same rotation", "same place") if word in str(found)] and len(
        found
    ) == 2


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


def test_one_of_several_people_may_be_in_a_corner() -> None:
    corner = with_joints(detections(), lambda joints: joints.mul_(0.45))
    pair = Detections.stack([corner, detections()])
    assert examine_places(rig(), pair) == []
    found = examine_places(rig(), Detections.stack([corner, corner]))
    assert [each.subject for each in found] == list(NAMES)
    assert all("top left quarter" in each.what for each in found)


def test_joints_found_in_the_images_themselves_fit_them() -> None:
    """A person who is filmed in one corner is no sign of half a size then."""

    def scale(joints: Tensor) -> None:
        joints[:, 0] *= 0.45

    corner = with_joints(detections(), scale)
    assert examine_detections(rig(), corner, detected=True) == []


def test_some_joints_outside() -> None:
    def shift(joints: Tensor) -> None:
        joints[:, 0, :4] += 900

    finding = one(examine_detections(rig(), with_joints(detections(), shift)))
    assert finding.severity is Severity.WARNING and "25% of the joints" in finding.what


@pytest.mark.parametrize("every", [2, 5])
def test_frames_that_are_repeated(every: int) -> None:
    def hold(joints: Tensor) -> None:
        joints[:, 0] = joints[torch.arange(FRAMES) // every * every, 0]

    finding = one(examine_detections(rig(), with_joints(detections(), hold)))
    repeated = FRAMES - len(range(0, FRAMES, every))
    assert finding.subject == "cam1" and f"{repeated} of 23 frames repeat" in finding.what
    unseen = replace(detections(), confidence2d=detections().confidence2d.clone())
    unseen.confidence2d[4:9] = 0
    unseen.joints2d[4:9] = 0  # nothing is seen in these frames: nothing is repeated
    assert not [f for f in examine_detections(rig(), unseen) if "repeat" in f.what]


@pytest.mark.parametrize("place", [0.0, -0.5, -1.0])
def test_places_of_what_is_not_detected(place: float) -> None:
    """Files have zeros there, which half a pixel may have moved, or minus ones."""

    def drop(joints: Tensor) -> None:
        joints[::6, 1, 4] = place

    finding = one(examine_detections(rig(), with_joints(detections(), drop)))
    assert finding.subject == "cam2" and "4 joints with confidence lie at" in finding.what


@pytest.mark.parametrize("views", [1, VIEWS])
def test_joints_in_another_order(views: int) -> None:
    """From several views, or with 3D poses, which are as wrong."""
    local = pose3d() if views == 1 else None
    seen = replace(detections(), joints3d=local)
    seen = replace(seen, trusted3d=torch.ones_like(seen.trusted3d)) if views == 1 else seen
    some = CameraRig(NAMES[:views], rig().cameras.select(list(range(views))))
    seen = seen.select(list(range(views)))
    order = torch.arange(16).flip(0)
    wrong = seen.map(lambda part: part[:, :, order] if part.ndim > 2 else part)
    assert examine_detections(some, seen) == []
    told = [f for f in examine_detections(some, wrong) if "stands on their head" in f.what]
    assert one(told).subject == "detections" and "joint set" in one(told).remedy
    assert "videos are upside down" in one(told).remedy


def test_who_leans_far_upside_down() -> None:
    """Axes are told by where feet are, however far a dancer leans."""
    seen, size = detections(), rig().cameras.size[0][0]
    lean = torch.linspace(-1.2, 1.2, seen.frame_count).sin()[:, None, None] * 1.4
    hips = seen.joints2d[..., 8:10, :].mean(-2, keepdim=True)
    away = seen.joints2d - hips
    leaning = torch.stack([away[..., 0] + lean * away[..., 1], away[..., 1]], dim=-1) + hips
    turned = torch.stack([leaning[..., 0], size - leaning[..., 1]], dim=-1)
    for points, known in ((leaning, False), (turned, True)):
        found = examine_detections(rig(), replace(seen, joints2d=points))
        assert any("stands on their head" in each.what for each in found) == known


def pose3d() -> Tensor:
    """The person in camera axes about the mid-hip, (F, C, 16, 3)."""
    local = rig().cameras.to_camera(person())
    hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
    return local - local[..., hips, :].mean(-2, keepdim=True)


@pytest.mark.long
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


@pytest.mark.long
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


@pytest.mark.long
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
