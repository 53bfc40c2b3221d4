"""Detections files of every kind."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from detection_files import (
    FRAMES,
    expected,
    moving,
    person,
    pose3d_mm,
    write_json,
    write_npz,
    write_openpose,
)

from perfcap.detect import joint_set as sets
from perfcap.detect.joint_set import JointSet
from perfcap.errors import InputError
from perfcap.io.calibration import read_cameras
from perfcap.io.detections import read_detections

DATA = Path(__file__).parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data beside this tree")


def check(path: Path, joint_set: JointSet, **options: Any) -> list[str]:
    detections, warnings = read_detections(path, **options)
    joints, confidence = expected(joint_set)
    torch.testing.assert_close(detections.joints2d[:, 0], joints)
    torch.testing.assert_close(detections.confidence2d[:, 0], confidence)
    return warnings


def test_npz(tmp_path: Path) -> None:
    assert check(write_npz(tmp_path / "detections.npz"), sets.LANDMARKS16, frames=FRAMES) == []


def test_npz_by_joint_names(tmp_path: Path) -> None:
    values = moving(sets.COCO17)
    spelled = [name.replace("l_", "left_").replace("r_", "right_") for name in sets.COCO17.joints]
    path = write_npz(
        tmp_path / "a.npz",
        joints2d=values[..., :2].astype(np.float32),
        confidence2d=values[..., 2],
        joint_names=np.array(spelled),
    )
    warnings = check(path, sets.COCO17)
    assert "has no r_toe, l_toe" in warnings[0]


def test_pixels_follow_the_camera_file(tmp_path: Path) -> None:
    values = moving(sets.LANDMARKS16)
    values[0, 3] = 0
    path = write_npz(tmp_path / "a.npz", joints2d=values[..., :2], confidence2d=values[..., 2])
    shifted, _ = read_detections(path, pixel_offset=-0.5)
    assert torch.equal(shifted.joints2d[1, 0], torch.from_numpy(values[1, :, :2] - 0.5))
    assert (shifted.joints2d[0, 0, 3] == 0).all() and shifted.confidence2d[0, 0, 3] == 0


def test_3d_in_metres_about_the_hips(tmp_path: Path) -> None:
    pose = pose3d_mm()
    detections, warnings = read_detections(write_npz(tmp_path / "a.npz", joints3d_mm=pose))
    assert warnings == [] and detections.trusted3d.all() and detections.joints3d is not None
    torch.testing.assert_close(detections.joints3d[:, 0], torch.from_numpy(pose) / 1000)
    moved, warnings = read_detections(write_npz(tmp_path / "b.npz", joints3d_mm=pose + 700))
    assert "not relative to the middle of the hips" in warnings[0]
    torch.testing.assert_close(moved.joints3d, detections.joints3d)


def test_arrays_that_are_not_read_are_named_once(tmp_path: Path) -> None:
    """3D poses under another name were left out without a word, and so were numbers of frames."""
    path = write_npz(tmp_path / "a.npz", joints3d=np.ones((6, 16, 3)), fps=np.array(25.0))
    _, notes = read_detections(path)
    assert notes == [
        f"{path}: holds what is not read (joints3d, fps); expected joints2d, confidence2d, "
        "joints3d_mm, joint_names, view_names, video_frames"
    ]
    with np.load(path) as one:
        views = {name: np.stack([one[name]] * 2, 1) for name in ("joints2d", "confidence2d")}
    np.savez(path, **views, boxes=np.ones(3))
    assert len(read_detections(path, views=2)[1]) == 1
    _, notes = read_detections(write_npz(tmp_path / "b.npz"))
    assert not notes


def test_3d_with_holes_is_not_trusted_there(tmp_path: Path) -> None:
    pose = pose3d_mm()
    pose[2, 5] = np.nan
    pose[3] = 0
    detections, _ = read_detections(write_npz(tmp_path / "a.npz", joints3d_mm=pose))
    assert detections.trusted3d[:, 0].tolist() == [True, True, False, False, True, True]
    assert detections.joints3d is not None and detections.joints3d.isfinite().all()


def test_several_views_in_one_npz_by_name(tmp_path: Path) -> None:
    values = np.stack([moving(sets.LANDMARKS16), moving(sets.LANDMARKS16) + 50], 1)
    path = write_npz(
        tmp_path / "a.npz",
        joints2d=values[..., :2],
        confidence2d=values[..., 2] * 0 + 1,
        view_names=np.array(["left", "right"]),
    )
    detections, _ = read_detections(path, views=["right", "left"])
    assert torch.equal(detections.joints2d[:, 0], torch.from_numpy(values[:, 1, :, :2]))
    assert read_detections(path, views=["right"])[0].views == 1
    with pytest.raises(InputError, match="hold 2 views, the cameras are 3"):
        read_detections(path, views=3)


def test_one_file_a_view_in_order_or_by_name(tmp_path: Path) -> None:
    for i, name in enumerate(("cam02_json", "cam01_json")):
        write_openpose(tmp_path / name, [[person(sets.BODY_25, 10.0 * i)]] * 3)
    paths = [tmp_path / "cam02_json", tmp_path / "cam01_json"]
    by_order, _ = read_detections(paths, views=2)
    by_name, _ = read_detections(paths, views=["int_cam01_img", "int_cam02_img"])
    apart = by_order.joints2d[:, 1] - by_order.joints2d[:, 0]
    torch.testing.assert_close(apart, torch.tensor([10.0, 0.0]).to(apart).expand_as(apart))
    assert torch.equal(by_name.joints2d, by_order.joints2d[:, [1, 0]])


OPENPOSE_SETS = [sets.COCO17, sets.COCO18, sets.BODY_25, sets.BODY_25B, sets.HALPE26]


@pytest.mark.parametrize("joint_set", [*OPENPOSE_SETS, sets.COCO_WHOLEBODY], ids=lambda s: s.name)
def test_openpose_folders(tmp_path: Path, joint_set: JointSet) -> None:
    people = [[frame] for frame in moving(joint_set)]
    check(write_openpose(tmp_path / "json", people, first=7), joint_set, frames=FRAMES)


def test_openpose_frames_without_people_or_file(tmp_path: Path) -> None:
    people: list[list[np.ndarray]] = [[person(sets.BODY_25)] for _ in range(6)]
    people[1] = []
    folder = write_openpose(tmp_path / "json", people)
    (folder / "take2_000000000002_keypoints.json").write_text("{}")
    (folder / "take2_000000000003_keypoints.json").unlink()
    (folder / "take2_000000000004_keypoints.json").write_text(
        '{"people": [{"pose_keypoints_2d": []}]}'
    )
    detections, warnings = read_detections(folder)
    seen = (detections.confidence2d > 0).any(-1)[:, 0]
    assert seen.tolist() == [True, False, False, False, False, True]
    assert "no file of 1 frame between 0 and 5" in warnings[0]


def test_the_prominent_person_is_followed(tmp_path: Path) -> None:
    """The bystander is listed first, is nearer in some frames' order, and remains alone once."""
    actor = [person(sets.BODY_25, 4.0 * f) for f in range(8)]
    bystander = person(sets.BODY_25, 220, 0.6)
    people = [[bystander, actor[f]] if f % 2 else [actor[f], bystander] for f in range(8)]
    people[5] = [bystander]
    detections, warnings = read_detections(write_openpose(tmp_path / "json", people))
    assert any("up to 2 people" in warning for warning in warnings)
    neck = detections.joints2d[:, 0, 1, 0]
    assert neck.tolist() == [300 + 4.0 * f if f != 5 else 0.0 for f in range(8)]


def alphapose(joint_set: JointSet, number: Any = lambda f: f"{f}.jpg") -> list[dict[str, Any]]:
    return [
        {"image_id": number(f), "category_id": 1, "score": 2.5, "keypoints": p.reshape(-1).tolist()}
        for f, p in enumerate(moving(joint_set))
    ]


def mmpose(joint_set: JointSet) -> list[dict[str, Any]]:
    return [
        {
            "frame_id": f + 1,
            "instances": [
                {
                    "keypoints": p[:, :2].tolist(),
                    "keypoint_scores": p[:, 2].tolist(),
                    "bbox_score": 1,
                }
            ],
        }
        for f, p in enumerate(moving(joint_set))
    ]


JSON_SETS = [sets.COCO17, sets.HALPE26, sets.COCO_WHOLEBODY, sets.HALPE136]


@pytest.mark.parametrize("joint_set", JSON_SETS, ids=lambda s: s.name)
def test_alphapose(tmp_path: Path, joint_set: JointSet) -> None:
    check(write_json(tmp_path / "a.json", alphapose(joint_set)), joint_set, frames=FRAMES)


@pytest.mark.parametrize("number", [lambda f: f, lambda f: f + 1, lambda f: f"im_{f + 1:04d}.png"])
def test_results_numbered_from_0_or_1(tmp_path: Path, number: Any) -> None:
    path = write_json(tmp_path / "a.json", alphapose(sets.COCO17, number))
    check(path, sets.COCO17, frames=FRAMES)
    check(path, sets.COCO17)


def test_results_leave_out_empty_frames(tmp_path: Path) -> None:
    entries = alphapose(sets.COCO17)[1:4]
    detections, warnings = read_detections(write_json(tmp_path / "a.json", entries), frames=FRAMES)
    seen = (detections.confidence2d > 0).any(-1)[:, 0]
    assert seen.tolist() == [False, True, True, True, False, False]
    assert any("counted from 0" in warning for warning in warnings)


@pytest.mark.parametrize("wrap", ["bare", "instance_info", "predictions", "nested"])
def test_mmpose(tmp_path: Path, wrap: str) -> None:
    frames = mmpose(sets.COCO_WHOLEBODY)
    data = {
        "bare": frames,
        "instance_info": {"meta_info": {}, "instance_info": frames},
        "predictions": {"predictions": frames},
        "nested": {"predictions": [frame["instances"] for frame in frames]},
    }[wrap]
    check(write_json(tmp_path / "a.json", data), sets.COCO_WHOLEBODY, frames=FRAMES)


def test_mmpose_frames_without_people_count(tmp_path: Path) -> None:
    frames = mmpose(sets.COCO17)
    frames[0]["instances"] = []
    detections, _ = read_detections(write_json(tmp_path / "a.json", frames), frames=FRAMES)
    assert (detections.confidence2d > 0).any(-1)[:, 0].tolist() == [False] + [True] * 5


@needs_data
def test_real_openpose_follows_the_same_man_as_the_associated_set() -> None:
    base = DATA / "pose2sim_balancing"
    names = read_cameras(base / "calibration/Calib_scene.toml").names
    read = [
        read_detections(sorted((base / kind).iterdir()), views=names, frames=61)
        for kind in ("pose2d_openpose", "pose2d_associated")
    ]
    (everyone, _), (man, warnings) = read
    assert man.joints2d.shape == (60, 4, 16, 2)
    assert any("the first 60 are used" in warning for warning in warnings)
    both = (everyone.confidence2d > 0) & (man.confidence2d > 0)
    different = (everyone.joints2d - man.joints2d).norm(dim=-1)[both] > 1
    assert different.double().mean() < 1e-3
    assert not man.confidence2d[52, 2].any()  # the entry that is {}


@needs_data
@pytest.mark.parametrize("sequence", ["dev_tight", "dev_skirt"])
def test_real_npz(sequence: str) -> None:
    folder = DATA / "rendered" / sequence
    rig = read_cameras(folder / "camera.json")
    detections, warnings = read_detections(
        folder / "detections.npz", views=rig.names, pixel_offset=rig.pixel_offset, frames=100
    )
    stored = np.load(folder / "detections.npz")["joints2d"]
    assert warnings == [] and detections.trusted3d.all()
    np.testing.assert_allclose(detections.joints2d[:, 0], stored - 0.5, atol=1e-5)


@pytest.mark.parametrize("rows", [slice(2, 4), slice(None)])
def test_3d_zeros_of_joints_that_are_not_seen_are_missing(tmp_path: Path, rows: slice) -> None:
    """They came near the hips with the shift to the middle of these, and counted as joints."""
    poses, values = pose3d_mm() + 5.0, moving(sets.LANDMARKS16)  # the origin is beside the hips
    mark, sure = sets.LANDMARKS.index("l_wrist"), values[..., 2].copy()
    poses[rows, mark], sure[rows, mark] = 0.0, 0.0
    gone = poses.copy()
    gone[rows, mark] = np.nan
    found, said = read_detections(
        write_npz(tmp_path / "a.npz", joints3d_mm=poses, confidence2d=sure)
    )
    true, wanted = read_detections(
        write_npz(tmp_path / "b.npz", joints3d_mm=gone, confidence2d=sure)
    )
    assert found.joints3d is not None and true.joints3d is not None
    assert torch.equal(found.trusted3d, true.trusted3d) and not found.trusted3d[rows].any()
    assert torch.equal(found.joints3d, true.joints3d)
    assert [line.split(": ")[1:] for line in said] == [line.split(": ")[1:] for line in wanted]
    assert any("no frame has a complete 3D pose" in line for line in said) == (rows == slice(None))
    seen, _ = read_detections(write_npz(tmp_path / "c.npz", joints3d_mm=poses))
    assert seen.trusted3d.all()  # a joint that the images show, as limits.md says
