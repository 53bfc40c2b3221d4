"""Frames, joints and confidences that JSON of landmarks calls by name or number."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from detection_files import FRAMES, expected, moving, write_json

from perfcap.detect import joint_set as sets
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.detections import read_detections

SIZE = (480, 640)  # height and width
NAMES = ("nose", *(f"{side}_{part}" for part in ("eye", "ear", "shoulder", "elbow", "wrist", "hip",
         "knee", "ankle") for side in ("left", "right")))  # fmt: skip


def check(path: Path, missing: int | None = None) -> None:
    found, notes = read_detections(path, sizes=[SIZE], frames=FRAMES)
    joints, confidence = expected(sets.COCO17)
    kept = [frame for frame in range(FRAMES) if frame != missing]
    assert len(found.joints2d) == FRAMES
    torch.testing.assert_close(found.joints2d[kept, 0], joints[kept])
    torch.testing.assert_close(found.confidence2d[kept, 0], confidence[kept])
    assert missing is None or not found.confidence2d[missing].any()
    assert not any("numbers of frames" in note for note in notes)


def person(values: np.ndarray, sure: str = "score") -> list[dict[str, Any]]:
    return [{"x": x, "y": y, sure: c} for x, y, c in values.tolist()]


def instances(values: np.ndarray) -> list[dict[str, Any]]:
    return [{"keypoints": values[:, :2].tolist(), "keypoint_scores": values[:, 2].tolist()}]


@pytest.mark.parametrize(
    "sure", ["inFrameLikelihood", "confidence_score", "keypointScore", "Visibility"]
)
def test_confidences_under_other_names(sure: str, tmp_path: Path) -> None:
    """ML Kit's is the first; every joint counted as seen."""
    check(write_json(tmp_path / "a.json", [person(p, sure) for p in moving(sets.COCO17)]))


@pytest.mark.parametrize("key", ["s", "p", "certainty", "Konfidenz"])
def test_confidences_under_names_that_are_not_known(key: str, tmp_path: Path) -> None:
    """Every joint counts as seen; beside one that is known, and of places and times, no word."""

    def said(sure: str, *, known: bool = False) -> list[str]:
        people = [person(values, sure) for values in moving(sets.COCO17)]
        for frame, landmarks in enumerate(people):
            for each in landmarks:
                each |= {"z": each["x"] / 999, "worldX": each["y"] / 999, "t": frame / 30}
                each |= {sure: each["x"] / 999}
                each |= {"score": 0.5} if known else {}
        path = write_json(tmp_path / "a.json", people)
        _, notes = read_detections(path, sizes=[SIZE], frames=FRAMES)
        return [note for note in notes if "no confidence" in note]

    (note,) = said(key)
    assert f"if {key!r} is it, call it 'score'" in note
    assert said(key, known=True) == said("z_norm") == []


@pytest.mark.parametrize("key", ["frame", "frame_index", "frameNumber", "image_id"])
@pytest.mark.parametrize("first", [0, 1])
def test_frames_that_are_left_out(key: str, first: int, tmp_path: Path) -> None:
    """All frames behind them were one early."""
    values = moving(sets.COCO17)
    kept = [frame for frame in range(FRAMES) if frame != 1]
    data: list[Any] = [{key: f + first, "landmarks": person(values[f])} for f in kept]
    check(write_json(tmp_path / "a.json", data), missing=1)
    check(write_json(tmp_path / "a.json", {"frames": data}), missing=1)
    data = [{key: f + first, "instances": instances(values[f])} for f in kept]
    check(write_json(tmp_path / "a.json", {"instance_info": data}), missing=1)


def test_the_last_frames_may_be_left_out_too(tmp_path: Path) -> None:
    values = moving(sets.COCO17)
    kept = [frame for frame in range(FRAMES - 2) if frame != 1]
    data = [{"frame": f, "landmarks": person(values[f])} for f in kept]
    found, _ = read_detections(write_json(tmp_path / "a.json", data), sizes=[SIZE], frames=FRAMES)
    assert found.confidence2d.amax((1, 2)).ne(0).nonzero()[:, 0].tolist() == kept


def test_frames_in_another_order_and_several_entries_of_one(tmp_path: Path) -> None:
    values = moving(sets.COCO17)
    small = values * [0.1, 0.1, 1]
    data = [
        {"frame": f, "id": n, "keypoints": person(one[f])}
        for f in reversed(range(FRAMES))
        for n, one in enumerate((small, values))
    ]
    check(write_json(tmp_path / "a.json", data))


@pytest.mark.parametrize("number", [lambda f: 2 * f, lambda f: 7, lambda f: 7 + f])
def test_numbers_that_say_nothing_of_the_video(number: Any, tmp_path: Path) -> None:
    """An entry a frame, numbered at another rate, all alike, or as in a longer recording."""
    values = moving(sets.COCO17)
    data = [{"frame": number(f), "landmarks": person(p)} for f, p in enumerate(values)]
    check(write_json(tmp_path / "a.json", data))


@pytest.mark.parametrize("key", ["name", "part"])
def test_joints_that_are_named_in_another_order(key: str, tmp_path: Path) -> None:
    order = np.argsort(NAMES)
    data = []
    for frame, values in enumerate(moving(sets.COCO17)):
        marks = [{key: NAMES[j], **person(values)[j]} for j in (order if frame else range(17))]
        data.append({"keypoints": marks})
    check(write_json(tmp_path / "a.json", data))
    data[0]["keypoints"] = [data[0]["keypoints"][j] for j in order]
    check(write_json(tmp_path / "a.json", data))


def test_views_of_an_archive_that_are_nearly_called_as_the_cameras(tmp_path: Path) -> None:
    """They were taken in the order of the file."""
    joints = np.random.default_rng(0).uniform(50, 400, (FRAMES, 3, 16, 2))
    np.savez(
        tmp_path / "a.npz",
        joints2d=joints,
        confidence2d=np.ones(joints.shape[:-1]),
        joint_names=LANDMARKS,
        view_names=["Cam03.mp4", "Cam01.mp4", "Cam02.mp4"],
    )
    found, _ = read_detections(tmp_path / "a.npz", views=["cam_1", "cam_2", "cam_3"])
    np.testing.assert_allclose(found.joints2d, joints[:, [1, 2, 0]])


def test_names_that_are_none(tmp_path: Path) -> None:
    data = [person(values) for values in moving(sets.COCO17)]
    for mark, name in zip(data[0], ("a", ["b"], {}, None), strict=False):
        mark["name"] = name
    check(write_json(tmp_path / "a.json", data))
