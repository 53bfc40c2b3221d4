"""Keypoints as scripts around MediaPipe, MoveNet, RTMPose, ViTPose and Sapiens save them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from detection_files import FRAMES, expected, moving, write_json

from perfcap.detect import joint_set as sets
from perfcap.detect.joint_set import JointSet
from perfcap.errors import InputError
from perfcap.io.detections import read_candidates, read_detections

SIZE = (480, 640)  # height and width


def check(path: Path, joint_set: JointSet, atol: float = 1e-9, **options: Any) -> list[str]:
    detections, warnings = read_detections(path, sizes=[SIZE], **options)
    joints, confidence = expected(joint_set)
    torch.testing.assert_close(detections.joints2d[:, 0], joints, atol=atol, rtol=0)
    torch.testing.assert_close(detections.confidence2d[:, 0], confidence)
    return warnings


def shares(values: np.ndarray) -> np.ndarray:
    """Pixels as parts of the image, whose left edge is half a pixel before the first centre."""
    height, width = SIZE
    return (values + np.array([0.5, 0.5, 0])) / np.array([width, height, 1])


def landmarks(values: np.ndarray, sure: str = "visibility") -> list[Any]:
    return [
        [{"x": x, "y": y, "z": 0.1, sure: c} for x, y, c in person] for person in values.tolist()
    ]


POSE = shares(moving(sets.BLAZEPOSE33))
FORMS = {
    "a list of people": [[person] for person in landmarks(POSE)],
    "one person a frame": landmarks(POSE),
    "PoseLandmarkerResult": [
        {"pose_landmarks": [person], "pose_world_landmarks": [person[:1]]}
        for person in landmarks(POSE)
    ],
    "solutions": [{"pose_landmarks": {"landmark": person}} for person in landmarks(POSE)],
    "under frames": {"fps": 30, "frames": [{"landmarks": p} for p in landmarks(POSE)]},
    "under numbers": {str(f): person for f, person in enumerate(landmarks(POSE))},
    "under numbers from 1": {str(f + 1): p for f, p in enumerate(landmarks(POSE))},
}


@pytest.mark.parametrize("form", FORMS)
def test_mediapipe_json(form: str, tmp_path: Path) -> None:
    check(write_json(tmp_path / "a.json", FORMS[form]), sets.BLAZEPOSE33, frames=FRAMES)


def test_movenet_of_javascript(tmp_path: Path) -> None:
    people = landmarks(moving(sets.COCO17), "score")
    data = [[{"keypoints": person, "score": 0.9}] for person in people]
    check(write_json(tmp_path / "a.json", data), sets.COCO17)


@pytest.mark.parametrize("sure", ["conf", "likelihood", "probability", "prob", "c", "v"])
@pytest.mark.parametrize("columns", [False, True])
def test_other_names_of_confidences(sure: str, columns: bool, tmp_path: Path) -> None:
    values = moving(sets.COCO17)
    values[..., 2] = np.linspace(0.2, 0.9, 17)
    people = [[{sure: c, "x": x, "y": y} for x, y, c in person] for person in values.tolist()]
    data: list[Any] = people
    if columns:
        data = [{key: [p[key] for p in one] for key in ("x", "y", sure)} for one in people]
    found, _ = read_detections(write_json(tmp_path / "a.json", data), sizes=[SIZE])
    places, given = torch.from_numpy(values[..., :2]), torch.from_numpy(values[..., 2])
    _, known = sets.map_to_landmarks(places, given, sets.COCO17)
    assert torch.allclose(found.confidence2d[:, 0], known)


def test_frames_without_anybody(tmp_path: Path) -> None:
    people: list[Any] = landmarks(POSE)
    people[2], people[3] = None, []
    found, _ = read_detections(write_json(tmp_path / "a.json", people), sizes=[SIZE])
    assert (found.confidence2d.amax((1, 2)) > 0).tolist() == [True, True, False, False, True, True]


ARRAYS = {
    "mediapipe.npy": (POSE, sets.BLAZEPOSE33),
    "holistic.npy": (np.concatenate((POSE, np.full((FRAMES, 510, 3), 0.5)), 1), sets.BLAZEPOSE33),
    "movenet.npy": (shares(moving(sets.COCO17))[:, None, None][..., [1, 0, 2]], sets.COCO17),
    "rtmpose.npy": (moving(sets.HALPE26)[:, None], sets.HALPE26),
    "vitpose.npy": (moving(sets.COCO_WHOLEBODY).astype(np.float64), sets.COCO_WHOLEBODY),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays(name: str, tmp_path: Path) -> None:
    values, joint_set = ARRAYS[name]
    np.save(tmp_path / name, values)
    check(tmp_path / name, joint_set)


def test_freemocap(tmp_path: Path) -> None:
    """All views in one array; NaN where MediaPipe saw nobody, no confidence."""
    pixels = moving(sets.BLAZEPOSE33)[..., :2]
    values = np.full((2, FRAMES, 553, 2), 7.0)
    values[0, :, :33], values[1, :, :33] = pixels, pixels + 10
    values[1, 2] = np.nan
    path = tmp_path / "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"
    np.save(path, values)
    found, _ = read_detections(path, views=2)
    joints, _ = expected(sets.BLAZEPOSE33)
    torch.testing.assert_close(found.joints2d[:, 0], joints)
    torch.testing.assert_close(found.joints2d[0, 1], joints[0] + (joints[0] != 0) * 10)
    assert found.confidence2d[:, 1].amax(-1).tolist() == [1, 1, 0, 1, 1, 1]


def test_several_people(tmp_path: Path) -> None:
    one = moving(sets.COCO17)
    values = np.stack((one, one + np.array([120, 0, 0]), 0 * one), 1)
    np.save(tmp_path / "a.npy", values)
    found, _ = read_candidates(tmp_path / "a.npy")
    assert found.joints2d.shape[:2] == (2, FRAMES)


@pytest.mark.parametrize("joint_set", [sets.COCO17, sets.COCO_WHOLEBODY])
def test_a_folder_of_sapiens(joint_set: JointSet, tmp_path: Path) -> None:
    folder = tmp_path / "view"
    folder.mkdir()
    for frame, person in enumerate(moving(joint_set)):
        one = {"keypoints": person[:, :2].tolist(), "keypoint_scores": person[:, 2].tolist()}
        write_json(folder / f"{frame:06d}.json", {"instance_info": [one]})
    check(folder, joint_set)


def test_shares_of_an_image_that_is_not_known(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", POSE)
    with pytest.raises(InputError, match="holds shares of the image instead of pixels"):
        read_detections(tmp_path / "a.npy")


WRONG_JSON = {
    "no list": ({"landmarks": landmarks(POSE)[0]}, "no list of frames"),
    "no number": ([[{"x": "left", "y": 1}] * 33], "are no numbers"),
    "no y": ([[{"x": 1, "y": 1}] * 32 + [{"x": 1}]], "without x and y"),
    "other joints": ([[{"x": 1, "y": 1}] * 5], "people have 5 joints"),
    "text": ([landmarks(POSE)[0], "x"], "holds no landmarks"),
}


@pytest.mark.parametrize("fault", WRONG_JSON)
def test_wrong_landmarks(fault: str, tmp_path: Path) -> None:
    data, said = WRONG_JSON[fault]
    with pytest.raises(InputError, match=said):
        read_detections(write_json(tmp_path / "a.json", data), sizes=[SIZE])


def test_wrong_arrays(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    for values, said in (
        (np.zeros((3, 4)), "expected .F,J,3."),
        (np.zeros((0, 17, 3)), "expected .F,J,3."),
        (np.zeros((4, 17, 4)), "expected .F,J,3."),
        (np.full((4, 17, 3), "x"), "expected numbers"),
        (np.ones((4, 9, 3)), "people have 9 joints"),
    ):
        np.save(path, values)
        with pytest.raises(InputError, match=said):
            read_detections(path)
    np.save(path, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="is no array of numbers"):
        read_detections(path)
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match="is no array of numbers"):
        read_detections(path)
    whole = np.ones((4, 17, 3))
    np.save(path, whole)
    path.write_bytes(path.read_bytes().replace(b"{'descr'", b"('descr'", 1))
    with pytest.raises(InputError, match="is no array of numbers"):
        read_detections(path)
    for other in (whole, np.ones((2, 4, 33, 1))):
        np.save(tmp_path / "numCams.npy", other)
        with pytest.raises(InputError, match="expected FreeMoCap's"):
            read_detections(tmp_path / "numCams.npy")
