"""Detections that hold what nobody should believe, or no detections at all."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from detection_files import FRAMES, moving, person, pose3d_mm, write_json, write_npz, write_openpose

from perfcap.detect import joint_set as sets
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.detections import read_candidates, read_detections


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


@pytest.mark.parametrize("reader", [read_detections, read_candidates])
def test_rows_of_a_longer_video_are_not_of_this_one(reader: Any, tmp_path: Path) -> None:
    """As many rows as the video has frames may have been cut from elsewhere in another one."""
    path = write_npz(tmp_path / "a.npz", video_frames=np.array(FRAMES + 20))
    said = f"a.npz is of {FRAMES + 20}, the video has {FRAMES}"
    with pytest.raises(InputError, match=said):
        reader(path, frames=FRAMES)
    with pytest.raises(InputError, match=said):
        reader(path, frames=FRAMES, total=FRAMES + 10)
    # a video that breaks off where the rows end, and one whose length is miscounted
    assert reader(path, frames=FRAMES, total=FRAMES + 20)[1] == []
    path = write_npz(tmp_path / "b.npz", video_frames=np.array(FRAMES + 4))
    assert reader(path, frames=FRAMES)[1] == []
    assert reader(path)[1] == []  # nothing is known of the video


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
