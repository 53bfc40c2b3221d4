"""Detections files of every kind, good and bad."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from perfcap.detect import joint_set as sets
from perfcap.detect.joint_set import LANDMARKS, JointSet
from perfcap.errors import InputError
from perfcap.io.calibration import read_cameras
from perfcap.io.detections import read_detections

DATA = Path(__file__).parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data beside this tree")

FRAMES = 6


def person(joint_set: JointSet = sets.LANDMARKS16, shift: float = 0.0, scale: float = 1.0) -> Any:
    """A standing pose (J, 3): where a joint is follows from its name, so order cannot matter."""
    rows = {"shoulder": -2, "elbow": -1, "wrist": 0, "hip": 0.2, "knee": 1, "ankle": 2}
    rows |= {"toe": 2.2, "heel": 2.1, "head_top": -3, "neck": -2, "nose": -2.7, "eye": -2.8}
    points = []
    for joint in joint_set.joints:
        side = {"r": -0.5, "l": 0.5}.get(joint.split("_")[0], 0.0)
        row = next((y for name, y in rows.items() if name in joint), 0.2)
        points.append((300 + 60 * scale * side + shift, 200 + 40 * scale * row, 0.9))
    return np.array(points)


def moving(joint_set: JointSet, frames: int = FRAMES) -> np.ndarray:
    return np.stack([person(joint_set, 3.0 * f) for f in range(frames)])


def expected(joint_set: JointSet) -> tuple[torch.Tensor, torch.Tensor]:
    values = torch.from_numpy(moving(joint_set))
    return sets.map_to_landmarks(values[..., :2], values[..., 2], joint_set)


def write_npz(path: Path, **change: Any) -> Path:
    values = moving(sets.LANDMARKS16)
    arrays = {"joints2d": values[..., :2], "confidence2d": values[..., 2], **change}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def write_openpose(folder: Path, people: list[list[np.ndarray]], first: int = 0) -> Path:
    folder.mkdir(parents=True)
    for f, candidates in enumerate(people):
        data = {
            "version": 1.3,
            "people": [{"pose_keypoints_2d": p.reshape(-1).tolist()} for p in candidates],
        }
        (folder / f"take2_{first + f:012d}_keypoints.json").write_text(json.dumps(data))
    return folder


def check(path: Path, joint_set: JointSet, **options: Any) -> list[str]:
    detections, warnings = read_detections(path, **options)
    joints, confidence = expected(joint_set)
    torch.testing.assert_close(detections.joints2d[:, 0], joints)
    torch.testing.assert_close(detections.confidence2d[:, 0], confidence)
    return warnings


# --- good files ---------------------------------------------------------------------------------


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
    assert "has no head_top, r_toe, l_toe" in warnings[0]


def test_pixels_follow_the_camera_file(tmp_path: Path) -> None:
    values = moving(sets.LANDMARKS16)
    values[0, 3] = 0
    path = write_npz(tmp_path / "a.npz", joints2d=values[..., :2], confidence2d=values[..., 2])
    shifted, _ = read_detections(path, pixel_offset=-0.5)
    assert torch.equal(shifted.joints2d[1, 0], torch.from_numpy(values[1, :, :2] - 0.5))
    assert (shifted.joints2d[0, 0, 3] == 0).all() and shifted.confidence2d[0, 0, 3] == 0


def pose3d_mm(frames: int = FRAMES) -> np.ndarray:
    flat = moving(sets.LANDMARKS16, frames)
    pose = np.concatenate((flat[..., :2] * 8, flat[..., 2:] * 0), -1)
    hips = [LANDMARKS.index("r_hip"), LANDMARKS.index("l_hip")]
    return pose - pose[:, hips].mean(1, keepdims=True)


def test_3d_in_metres_about_the_hips(tmp_path: Path) -> None:
    pose = pose3d_mm()
    detections, warnings = read_detections(write_npz(tmp_path / "a.npz", joints3d_mm=pose))
    assert warnings == [] and detections.trusted3d.all() and detections.joints3d is not None
    torch.testing.assert_close(detections.joints3d[:, 0], torch.from_numpy(pose) / 1000)
    moved, warnings = read_detections(write_npz(tmp_path / "b.npz", joints3d_mm=pose + 700))
    assert "not relative to the middle of the hips" in warnings[0]
    torch.testing.assert_close(moved.joints3d, detections.joints3d)


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
    torch.testing.assert_close(by_order.joints2d[:, 1, 0], by_order.joints2d[:, 0, 0])
    assert (by_order.joints2d[:, 1, 2, 0] - by_order.joints2d[:, 0, 2, 0] == 10).all()
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
    assert "1 frames between 0 and 5 have no file" in warnings[0]


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


def write_json(path: Path, data: Any) -> Path:
    path.write_text(json.dumps(data))
    return path


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


# --- bad files ----------------------------------------------------------------------------------


def test_not_finite_is_dropped_and_counted(tmp_path: Path) -> None:
    values = moving(sets.LANDMARKS16)
    values[1, 2, 0] = np.nan
    values[1, 3, 1] = np.inf
    values[4, 0, 2] = np.nan
    path = write_npz(tmp_path / "a.npz", joints2d=values[..., :2], confidence2d=values[..., 2])
    detections, warnings = read_detections(path)
    assert "3 joints in 2 frames are NaN" in warnings[0]
    assert detections.joints2d.isfinite().all() and detections.confidence2d.isfinite().all()
    assert (detections.confidence2d == 0).sum() == 3


def test_confidence_above_one_is_cut_and_said(tmp_path: Path) -> None:
    path = write_npz(tmp_path / "a.npz", confidence2d=np.full((FRAMES, 16), 3.0))
    detections, warnings = read_detections(path)
    assert (detections.confidence2d == 1).all() and "confidences up to 3" in warnings[0]


@pytest.mark.parametrize(("video", "kept"), [(FRAMES + 2, FRAMES), (FRAMES - 2, FRAMES - 2)])
def test_a_few_frames_at_the_end_may_differ(tmp_path: Path, video: int, kept: int) -> None:
    detections, warnings = read_detections(write_npz(tmp_path / "a.npz"), frames=video)
    assert detections.frame_count == kept and f"first {kept} are used" in warnings[0]


def test_many_frames_may_not(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="numbers of frames differ"):
        read_detections(write_npz(tmp_path / "a.npz"), frames=FRAMES + 20)


def test_a_view_may_be_empty_but_not_all(tmp_path: Path) -> None:
    full = write_openpose(tmp_path / "a", [[person(sets.BODY_25)]] * 4)
    empty = write_openpose(tmp_path / "b", [[]] * 4)
    detections, _ = read_detections([full, empty], views=2)
    assert not detections.confidence2d[:, 1].any()
    with pytest.raises(InputError, match="nobody is detected"):
        read_detections(empty)


BAD_ARRAYS: dict[str, tuple[dict[str, Any], str]] = {
    "no joints": ({"joints2d": None}, "has no joints2d"),
    "no confidence": ({"confidence2d": None}, "has no confidence2d"),
    "shape": ({"joints2d": np.zeros((5, 2))}, "joints2d has shape"),
    "no frames": ({"joints2d": np.zeros((0, 16, 2))}, "joints2d has shape"),
    "confidence": ({"confidence2d": np.zeros((5, 16))}, "confidence2d has shape"),
    "3d": ({"joints3d_mm": np.zeros((5, 16, 3))}, "joints3d_mm has shape"),
    "count": (
        {"joints2d": np.ones((5, 17, 2)), "confidence2d": np.ones((5, 17))},
        "17 joints and no joint_names",
    ),
    "words": ({"joints2d": np.array(["a"])}, "expected numbers"),
    "unknown names": (
        {"joint_names": np.array(["tail", "wing", *LANDMARKS[2:]])},
        "unknown tail, wing",
    ),
    "names twice": (
        {"joint_names": np.array(["neck", "neck", *LANDMARKS[2:]])},
        "neck more than once",
    ),
    "few names": ({"joint_names": np.array(["neck"])}, "expected 16 strings"),
    "metres": ({"joints3d_mm": pose3d_mm() / 1000}, "looks like metres"),
    "nobody": ({"confidence2d": np.zeros((FRAMES, 16))}, "nobody is detected"),
    "objects": ({"joints2d": np.array([{}, []], dtype=object)}, "npz archive of plain arrays"),
}


@pytest.mark.parametrize("case", BAD_ARRAYS)
def test_bad_npz(tmp_path: Path, case: str) -> None:
    change, words = BAD_ARRAYS[case]
    with pytest.raises(InputError, match=words) as caught:
        read_detections(write_npz(tmp_path / "a.npz", **change))
    assert "a.npz" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"PK\x03\x04 broken", b"text", b"\x93NUMPY"])
def test_npz_that_is_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(InputError, match="not a readable npz"):
        read_detections(tmp_path / "a.npz")


def test_cut_npz(tmp_path: Path) -> None:
    whole = write_npz(tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="not a readable npz"):
        read_detections(tmp_path / "a.npz")


@pytest.mark.parametrize("packed", [False, True])
def test_npz_with_damaged_member(tmp_path: Path, packed: bool) -> None:
    path = write_npz(tmp_path / "a.npz")
    if packed:
        with np.load(path) as arrays:
            np.savez_compressed(path, **arrays)
    data = bytearray(path.read_bytes())
    data[300] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputError, match="not a readable npz"):
        read_detections(path)


def test_zip_bomb(tmp_path: Path) -> None:
    """An archive of a few kilobytes that says it holds three gigabytes."""
    header = io.BytesIO()
    np.lib.format.write_array_header_2_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (30_000_000, 16, 2)}
    )
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("joints2d.npy", header.getvalue())
    data = (tmp_path / "a.npz").read_bytes()
    size = len(header.getvalue()).to_bytes(4, "little")
    at = data.rindex(size)  # the uncompressed size in the central directory
    (tmp_path / "a.npz").write_bytes(data[:at] + (3 * 2**30).to_bytes(4, "little") + data[at + 4 :])
    with pytest.raises(InputError, match="unpacks to"):
        read_detections(tmp_path / "a.npz")


def bad_person(values: Any) -> str:
    return json.dumps({"people": [{"pose_keypoints_2d": values}]})


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ('{"people": [', "not valid JSON"),
        ("[1]", "no list 'people'"),
        ('{"people": 3}', "no list 'people'"),
        ('{"people": [{"pose_keypoints_2d": 3}]}', "no list 'pose_keypoints_2d'"),
        (bad_person([1, 2, 3, 4]), "has 4 numbers"),
        (bad_person(["x"] * 75), "not numbers"),
        (bad_person([10**400] * 75), "not numbers"),
        ('{"people": ' + "9" * 5000 + "}", "not usable JSON"),
        (bad_person([1.0] * 75)[:-2] + ', {"pose_keypoints_2d": [1, 2, 3]}]}', "1 and 25 joints"),
    ],
)
def test_bad_openpose(tmp_path: Path, content: str, words: str) -> None:
    folder = write_openpose(tmp_path / "json", [[person(sets.BODY_25)]] * 2)
    (folder / "take2_000000000001_keypoints.json").write_text(content)
    with pytest.raises(InputError, match=words):
        read_detections(folder)


def test_odd_openpose_folders(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no JSON files"):
        read_detections(tmp_path / "empty")
    with pytest.raises(InputError, match="people have 7 joints"):
        read_detections(write_openpose(tmp_path / "seven", [[np.ones((7, 3))]]))
    folder = write_openpose(tmp_path / "twice", [[person(sets.BODY_25)]])
    (folder / "other_0.json").write_text("{}")
    with pytest.raises(InputError, match="is frame 0 as is"):
        read_detections(folder)
    (folder / "other_0.json").rename(folder / "other_20261101.json")
    with pytest.raises(InputError, match="expected frame numbers that count up"):
        read_detections(folder)
    (folder / "other_20261101.json").rename(folder / "summary.json")
    with pytest.raises(InputError, match="no frame number"):
        read_detections(folder)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (3, "not a list of results"),
        ([], "empty list"),
        ([[]], "nobody is detected"),
        ([1], "not a list of results"),
        ([{"keypoints": [1, 2, 3]}], "lacks image_id"),
        ([{"image_id": None, "keypoints": [1, 2, 3]}], "has no frame number"),
        ([{"image_id": "a.jpg", "keypoints": [1, 2, 3]}], "has no frame number"),
        ([{"image_id": 1, "keypoints": [1, 2]}], "has 2 numbers"),
        ([{"image_id": 1, "keypoints": [1.0] * 9}], "3 joints, expected 17"),
        ([{"image_id": -3, "keypoints": [1.0] * 51}], "expected them to count up"),
        ([{"image_id": n, "keypoints": [1.0] * 51} for n in (0, 10**9)], "count up"),
        ([{"instances": 3}], "no list 'instances'"),
        ([{"instances": [3]}], "has no keypoints"),
        ([{"instances": [{"keypoints": [[1, 2, 3]], "keypoint_scores": [1]}]}], "expected"),
        ([{"instances": [{"keypoints": "a", "keypoint_scores": [1]}]}], "not numbers"),
    ],
)
def test_bad_keypoint_json(tmp_path: Path, data: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_detections(write_json(tmp_path / "a.json", data))


def test_unknown_and_missing_paths(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_detections(tmp_path / "a.npz")
    (tmp_path / "a.csv").write_text("1,2")
    with pytest.raises(InputError, match="not a detections file"):
        read_detections(tmp_path / "a.csv")
