"""Joints under the names of images are those of these images, whoever is not seen before them."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from detection_files import person

from perfcap.detect.joint_set import COCO17
from perfcap.io.detections import read_candidates, read_detections

SIZE = (480, 640)
COUNT = 8


def _alphapose(place: Path, people: dict[str, np.ndarray]) -> Path:
    rows = [
        {"image_id": f"{name}.jpg", "keypoints": each.reshape(-1).tolist(), "score": 1.0}
        for name, each in people.items()
    ]
    path = place / "alphapose-results.json"
    path.write_text(json.dumps(rows))
    return path


def _coco(place: Path, people: dict[str, np.ndarray]) -> Path:
    images = [{"id": 7 + k, "file_name": f"take/{name}.png"} for k, name in enumerate(people)]
    rows = [
        {"image_id": 7 + k, "keypoints": each.reshape(-1).tolist()}
        for k, each in enumerate(people.values())
    ]
    path = place / "coco.json"
    path.write_text(json.dumps({"images": images, "annotations": rows}))
    return path


def _yolo(place: Path, people: dict[str, np.ndarray]) -> Path:
    folder = place / "labels"
    folder.mkdir()
    for name, each in people.items():
        shares = (each + np.array([0.5, 0.5, 0])) / (SIZE[1], SIZE[0], 1)
        numbers = [0, 0.5, 0.5, 0.2, 0.4, *shares.reshape(-1)]
        (folder / f"{name}.txt").write_text(" ".join(f"{n:.9f}" for n in numbers))
    return folder


def _openpose(place: Path, people: dict[str, np.ndarray]) -> Path:
    folder = place / "json"
    folder.mkdir()
    for name, each in people.items():
        data = {"people": [{"keypoints": each[:, :2].tolist(), "keypoint_scores": [0.9] * 17}]}
        rows = data["people"]
        (folder / f"{name}_keypoints.json").write_text(json.dumps(rows))
    return folder


@pytest.mark.parametrize("write", [_alphapose, _coco, _yolo, _openpose])
@pytest.mark.parametrize(
    ("first", "step", "unseen"),
    [(1, 1, (6, 7)), (0, 1, (0,)), (40, 1, (0, 1)), (0, 5, (2,)), (1, 1, ())],
)
def test_names_of_images_say_which_frame_joints_are_of(
    tmp_path: Path,
    write: Callable[[Path, dict[str, np.ndarray]], Path],
    first: int,
    step: int,
    unseen: tuple[int, ...],
) -> None:
    images = [f"img_{first + step * frame:04d}" for frame in range(COUNT)]
    people = {
        name: person(COCO17, 10.0 * frame)
        for frame, name in enumerate(images)
        if frame not in unseen
    }
    path = write(tmp_path, people)
    for read in (read_detections, read_candidates):
        found, _ = read(path, views=["one"], frames=COUNT, sizes=[SIZE], images=[images])
        count = found.frame_count  # folders with a file a frame end with the last one
        seen = found.confidence2d.reshape(count, 16)[:, 2] > 0
        shown = [frame not in unseen for frame in range(COUNT)]
        assert seen.tolist() == shown[:count] and not any(shown[count:])
        there = found.joints2d.reshape(count, 16, 2)[seen][:, 2, 0]
        assert np.allclose(there, 270.0 + 10 * np.flatnonzero(shown), atol=1e-3)


def test_other_names_are_counted_as_before(tmp_path: Path) -> None:
    people = {f"take_{frame}": person(COCO17, 10.0 * frame) for frame in range(1, COUNT)}
    path = _alphapose(tmp_path, people)
    images = [f"img_{frame:04d}" for frame in range(1, COUNT + 1)]
    given = [read_detections(path, frames=COUNT, images=each)[0] for each in ((), [images])]
    assert (given[0].joints2d == given[1].joints2d).all()
