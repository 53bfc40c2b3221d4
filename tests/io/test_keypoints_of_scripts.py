"""Keypoints as Ultralytics, MMPose and scripts around MediaPipe save them, and what is none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from detection_files import FRAMES, expected, moving, write_json

from perfcap.detect import joint_set as sets
from perfcap.detect.joint_set import JointSet
from perfcap.errors import InputError
from perfcap.io.detections import read_detections

SIZE = (480, 640)  # height and width


def check(path: Path, joint_set: JointSet, first: int = 0) -> None:
    found, _ = read_detections(path, sizes=[SIZE], frames=FRAMES)
    joints, confidence = expected(joint_set)
    torch.testing.assert_close(found.joints2d[first:, 0], joints[first:], atol=1e-9, rtol=0)
    torch.testing.assert_close(found.confidence2d[first:, 0], confidence[first:])
    assert float(found.confidence2d[:first].sum()) == 0


def shares(values: np.ndarray) -> np.ndarray:
    """Pixels as parts of the image, whose left edge is half a pixel before the first centre."""
    found: np.ndarray = (values + np.array([0.5, 0.5, 0])) / np.array([SIZE[1], SIZE[0], 1])
    return found


def landmarks(values: np.ndarray) -> list[Any]:
    return [{"x": x, "y": y, "visibility": c} for x, y, c in values.tolist()]


@pytest.mark.parametrize("nothing", [None, [], [[]]])
def test_mediapipe_that_finds_nobody_at_first(nothing: Any, tmp_path: Path) -> None:
    data: list[Any] = [{"pose_landmarks": landmarks(p)} for p in shares(moving(sets.BLAZEPOSE33))]
    data[:2] = [{"pose_landmarks": nothing}] * 2
    check(write_json(tmp_path / "a.json", data), sets.BLAZEPOSE33, first=2)


def with_depth(depth: np.ndarray) -> np.ndarray:
    values = shares(moving(sets.BLAZEPOSE33))
    spread = np.broadcast_to(depth[:, None], (*values.shape[:-1], 1))
    return np.concatenate((values[..., :2], spread, values[..., 2:]), -1)


DEPTH = np.linspace(-0.6, 0.4, 33)


def test_a_depth_before_the_visibility_is_left_out(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", with_depth(DEPTH))
    check(tmp_path / "a.npy", sets.BLAZEPOSE33)


@pytest.mark.parametrize("unit", [1.0, SIZE[1]])
def test_a_depth_is_no_confidence(unit: float, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", with_depth(DEPTH * unit)[..., :3])
    with pytest.raises(InputError, match="expected a confidence, 0 to 1"):
        read_detections(tmp_path / "a.npy", sizes=[SIZE])


@pytest.mark.parametrize("unseen", [-0.02, -1.0])
def test_confidences_below_zero(unseen: float, tmp_path: Path) -> None:
    values = moving(sets.COCO17)
    values[:, 3:8, 2] = unseen
    np.save(tmp_path / "a.npy", values)
    assert read_detections(tmp_path / "a.npy", sizes=[SIZE])[0].confidence2d.amax() > 0


def ultralytics(values: np.ndarray, leave: str = "") -> dict[str, Any]:
    columns = dict(zip(("x", "y", "visible"), values.T.tolist(), strict=True))
    columns.pop(leave, None)
    return {"name": "person", "class": 0, "confidence": 0.9, "keypoints": columns}


@pytest.mark.parametrize("listed", [True, False])
def test_ultralytics(listed: bool, tmp_path: Path) -> None:
    people = [ultralytics(person) for person in moving(sets.COCO17)]
    data = [[person] for person in people] if listed else people
    check(write_json(tmp_path / "a.json", data), sets.COCO17)


def test_ultralytics_without_confidence(tmp_path: Path) -> None:
    people = [[ultralytics(person, "visible")] for person in moving(sets.COCO17)]
    found, _ = read_detections(write_json(tmp_path / "a.json", people), sizes=[SIZE])
    assert float(found.confidence2d.amax()) == 1


@pytest.mark.parametrize("columns", [{"x": [1.0], "y": [1.0, 2.0]}, {"x": 1.0, "y": [1.0]}])
def test_columns_that_do_not_match(columns: dict[str, Any], tmp_path: Path) -> None:
    path = write_json(tmp_path / "a.json", [[{"keypoints": columns}]])
    with pytest.raises(InputError, match="frame 0 has x, y and visible that are no equal lists"):
        read_detections(path, sizes=[SIZE])


def predictions(names: list[str]) -> dict[str, Any]:
    frames = [
        {"frame_id": f, "instances": [{"keypoints": p[:, :2].tolist(),
                                       "keypoint_scores": p[:, 2].tolist()}]}
        for f, p in enumerate(moving(sets.COCO17))
    ]  # fmt: skip
    meta = {"dataset_name": "h36m", "keypoint_id2name": {str(i): n for i, n in enumerate(names)}}
    return {"meta_info": meta, "instance_info": frames}


HUMAN36M = ["root", "right_hip", "right_knee", "right_foot", "left_hip", "left_knee", "left_foot"]
COCO = ["nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder"]


def test_mmpose_of_another_data_set(tmp_path: Path) -> None:
    path = write_json(tmp_path / "a.json", predictions(HUMAN36M))
    with pytest.raises(InputError, match=r"keypoint 1 is 'right_hip' \(data set 'h36m'\)"):
        read_detections(path, sizes=[SIZE])


def test_mmpose_with_names(tmp_path: Path) -> None:
    check(write_json(tmp_path / "a.json", predictions(COCO)), sets.COCO17)
