"""Keypoints as other programs write them: read, or refused with what to do instead."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from perfcap.errors import InputError
from perfcap.io.detections import read_detections

FRAMES = 6
SIZE = (400, 800)  # height, width
NAMES = ["nose", *(f"{side}_{part}" for part in ("eye", "ear") for side in ("left", "right"))]
NAMES += [
    f"{side}_{part}"
    for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in ("left", "right")
]


def keypoints() -> np.ndarray:
    """COCO's 17 in each frame, (F, 17, 3), pixels and scores."""
    draw = np.random.default_rng(4)
    person = draw.uniform((100, 50, 0.5), (700, 350, 0.9), (17, 3))
    moved = np.stack([person] * FRAMES)
    moved[..., 0] += 4.0 * np.arange(FRAMES)[:, None]
    return moved.round(3)


def read(path: Path) -> torch.Tensor:
    found, _ = read_detections(path, views=1, frames=FRAMES, sizes=[SIZE])
    return found.joints2d[:, 0]


def write(path: Path, data: Any) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(data))
    return path


@pytest.fixture
def expected(tmp_path: Path) -> torch.Tensor:
    np.save(tmp_path / "expected.npy", keypoints())
    return read(tmp_path / "expected.npy")


def flat(values: np.ndarray) -> list[float]:
    return list(values.ravel().tolist())


@pytest.mark.parametrize(
    ("people", "numbers"), [("people", "pose_keypoints_2d"), ("bodies", "joints")]
)
def test_alphapose_by_image(
    tmp_path: Path, expected: torch.Tensor, people: str, numbers: str
) -> None:
    """``--format open`` and ``cmu``: a neck is added, and joints are in OpenPose's order."""
    found = keypoints()
    neck = (found[:, 5] + found[:, 6]) / 2
    rest = [found[:, i] for i in (6, 8, 10, 5, 7, 9, 12, 14, 16, 11, 13, 15, 2, 1, 4, 3)]
    openpose = np.stack([found[:, 0], neck, *rest], 1)
    data = {
        f"{f}.jpg": {"version": "AlphaPose v0.3", people: [{numbers: flat(each)}]}
        for f, each in enumerate(openpose)
    }
    torch.testing.assert_close(read(write(tmp_path / "a.json", data))[:, 2:], expected[:, 2:])


def test_coco_whose_ids_are_in_another_order(tmp_path: Path, expected: torch.Tensor) -> None:
    """Frames were taken for those of the ids: the same poses in another order of time."""
    order = [3, 0, 5, 1, 4, 2]
    images = [{"id": order[f] + 7, "file_name": f"a/frame_{f:04d}.jpg"} for f in range(FRAMES)]
    annotations = [
        {"image_id": order[f] + 7, "keypoints": flat(each)} for f, each in enumerate(keypoints())
    ]
    data = {"images": images, "annotations": annotations}
    torch.testing.assert_close(read(write(tmp_path / "a.json", data)), expected)
    for image in images:  # numbers that do not count
        image["file_name"] = f"{image['id'] ** 9}.jpg"
    assert not torch.allclose(read(write(tmp_path / "b.json", data)), expected)


def test_easy_vitpose(tmp_path: Path, expected: torch.Tensor) -> None:
    people = [{"3": each[:, [1, 0, 2]].tolist()} for each in keypoints()]
    skeleton = {str(i): name for i, name in enumerate(NAMES)}
    data = {"keypoints": people, "skeleton": skeleton}
    torch.testing.assert_close(read(write(tmp_path / "a.json", data)), expected)
    data = {"keypoints": people, "skeleton": {"0": "L_Eye", "1": "Neck", "2": "root_of_tail"}}
    with pytest.raises(InputError, match="no hips and shoulders"):
        read(write(tmp_path / "a.json", data))
    data = {"keypoints": [{"3": [[1, 2, 3]]}], "skeleton": skeleton}
    with pytest.raises(InputError, match=r"keypoints \(1, 3\), expected \(17, 3\)"):
        read(write(tmp_path / "a.json", data))


def test_vitpose_of_transformers_and_of_its_authors(tmp_path: Path, expected: torch.Tensor) -> None:
    data = [
        [{"keypoints": each[:, :2].tolist(), "scores": each[:, 2].tolist(), "bbox": [0, 0, 1, 1]}]
        for each in keypoints()
    ]
    torch.testing.assert_close(read(write(tmp_path / "a.json", data)), expected)
    data = [[{"keypoints": each.tolist(), "bbox": [0, 0, 1, 1, 0.9]}] for each in keypoints()]
    torch.testing.assert_close(read(write(tmp_path / "b.json", data)), expected)


def test_mmpose_of_single_images(tmp_path: Path, expected: torch.Tensor) -> None:
    for f, each in enumerate(keypoints()):
        person = {"keypoints": each[:, :2].tolist(), "keypoint_scores": each[:, 2].tolist()}
        write(tmp_path / "predictions" / f"{f:06d}.json", [person])
    torch.testing.assert_close(read(tmp_path / "predictions"), expected)


@pytest.mark.parametrize("data", [{"bodies": []}, [{"x": 1, "y": 2}], {"pose_landmarks": []}])
def test_folders_of_another_program(tmp_path: Path, data: Any) -> None:
    """Objects without people were said to detect nobody."""
    for f in range(FRAMES):
        write(tmp_path / "json" / f"{f}.json", data)
    with pytest.raises(InputError, match="one file with a list of all frames"):
        read(tmp_path / "json")


@pytest.mark.parametrize("more", [(), (0.8,), (0.8, 3)])
@pytest.mark.parametrize("scored", [True, False])
def test_labels_of_ultralytics(
    tmp_path: Path, expected: torch.Tensor, more: tuple[float, ...], scored: bool
) -> None:
    shares = keypoints() / [SIZE[1], SIZE[0], 1]
    shares = shares[..., : 3 if scored else 2]
    run = tmp_path / "predict"
    folder = run / "labels" if more else run
    folder.mkdir(parents=True)
    for f, each in enumerate(shares):
        if f not in (1, FRAMES - 1):  # nobody there, no file
            line = " ".join(map(str, (0, 0.5, 0.5, 0.1, 0.2, *flat(each), *more)))
            (folder / f"dance_{f + 1}.txt").write_text(line + "\n")
    found, _ = read_detections(run, views=1, frames=FRAMES, sizes=[SIZE])
    seen = found.views_with_person().new_tensor([f not in (1, FRAMES - 1) for f in range(FRAMES)])
    assert ((found.confidence2d[:, 0] > 0).any(-1) == seen).all()
    torch.testing.assert_close(
        found.joints2d[seen, 0], expected[seen] - 0.5 * (expected[seen] != 0)
    )


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.txt", "0 1 2", "no frame number"),
        ("a_1.txt", "0 0.5 0.5 0.1 0.2", "a line has 5 numbers, expected a class"),
        ("a_1.txt", "person 0.5", "no list of numbers"),
        ("classes.txt", "person", "no text files of frames"),
    ],
)
def test_labels_that_are_none(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said):
        read(tmp_path)


def test_world_landmarks_of_mediapipe(tmp_path: Path) -> None:
    """Metres about the hips were taken for shares of the image."""
    draw = np.random.default_rng(2)
    places = draw.uniform(-0.6, 0.6, (FRAMES, 33, 2))
    places -= places[:, [23, 24]].mean(1, keepdims=True)

    def frames(places: np.ndarray) -> list[Any]:
        return [[{"x": x, "y": y, "visibility": 0.9} for x, y in each] for each in places.tolist()]

    with pytest.raises(InputError, match="pose_world_landmarks; give pose_landmarks"):
        read(write(tmp_path / "a.json", frames(places)))
    read(write(tmp_path / "a.json", frames(0.5 + places / 2)))


def test_what_to_write_instead(tmp_path: Path) -> None:
    ragged = np.empty(2, object)
    ragged[:] = [np.zeros((1, 17, 3)), np.zeros((2, 17, 3))]
    np.save(tmp_path / "ragged.npy", ragged, allow_pickle=True)
    np.save(tmp_path / "space.npy", np.full((FRAMES, 33, 3), 900.0))
    write(tmp_path / "text.json", [json.dumps([])] * FRAMES)
    write(tmp_path / "other.json", [{"score": 1.0, "keypoints": [1, 2, 3]}])
    (tmp_path / "dlc.csv").write_text("scorer,DLC\n")
    for name, said in {
        "ragged.npy": "fill up what is missing with NaN",
        "space.npy": "joints in space, as FreeMoCap's 3D, are not read",
        "text.json": "write json.loads(...) of each",
        "other.json": "(it has score, keypoints)",
        "dlc.csv": "as .npy [F,17,3]",
    }.items():
        with pytest.raises(InputError, match=re.escape(said)):
            read(tmp_path / name)
