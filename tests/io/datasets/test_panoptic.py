"""CMU Panoptic: a calibration and a JSON file a frame."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scenes import Floats, assert_everybody, assert_landmarks, cameras, person

from perfcap.app.truth_people import match_truths, read_truths
from perfcap.errors import InputError
from perfcap.io.datasets import find_dataset
from perfcap.io.datasets.joint_sets import COCO19

DATASET = find_dataset("panoptic")
NAME = "171204_pose1"


def body(identity: int, points: Floats) -> dict[str, Any]:
    rows = np.concatenate((100 * points, np.full((19, 1), 0.7)), 1)
    rows[4, 3] = -1  # not found
    return {"id": identity, "joints19": rows.ravel().tolist()}


def write(folder: Path, people: tuple[int, ...] = (0,)) -> Path:
    place = folder / NAME
    poses = place / "hdPose3d_stage1_coco19"
    poses.mkdir(parents=True)
    for frame in range(5):
        bodies = [body(p, person(COCO19, seed=p)[frame]) for p in people if frame != 3]
        scene = {"version": 0.7, "univTime": 1.0, "fpsType": "hd_29_97", "bodies": bodies}
        (poses / f"body3DScene_{140 + frame:08d}.json").write_text(json.dumps(scene))
    camera = cameras(2, 1000)
    views = [
        {
            "name": f"00_{view:02d}",
            "type": "hd",
            "resolution": [1920, 1080],
            "panel": 0,
            "node": view,
            "K": camera.intrinsics[view].tolist(),
            "distCoef": [-0.2, 0.1, 0.001, 0.002, 0.03],
            "R": camera.rotation[view].tolist(),
            "t": (100 * camera.translation[view])[:, None].tolist(),
        }
        for view in range(2)
    ]
    others = [views[0] | {"name": "01_01", "type": "vga"}]
    (place / f"calibration_{NAME}.json").write_text(json.dumps({"cameras": others + views}))
    return place


def test_panoptic(tmp_path: Path) -> None:
    write(tmp_path)
    assert DATASET.sequences(tmp_path) == (NAME,)
    sequence = DATASET.read(tmp_path, NAME)
    assert sequence.joints3d is not None and sequence.rig is not None
    points = person(COCO19)
    points[3], points[:, 4] = np.nan, np.nan
    assert_landmarks(sequence.joints3d, points, COCO19)
    assert sequence.frames.tolist() == [140, 141, 142, 143, 144]
    assert sequence.rig.names == ("00_00", "00_01")
    torch.testing.assert_close(sequence.rig.cameras.translation, cameras(2, 1000).translation)
    assert sequence.rig.cameras.size == ((1080, 1920),) * 2
    pixels = sequence.joints2d()
    assert pixels is not None and pixels[3].isnan().all() and pixels[0, :, 1].isfinite().all()


def test_one_of_several_people(tmp_path: Path) -> None:
    write(tmp_path, (2, 5))
    with pytest.raises(InputError, match=f"shows 2 people; name one: {NAME}/2, {NAME}/5"):
        DATASET.read(tmp_path, NAME)
    sequence = DATASET.read(tmp_path, f"{NAME}/5")
    assert sequence.joints3d is not None
    points = person(COCO19, seed=5)
    points[3], points[:, 4] = np.nan, np.nan
    assert_landmarks(sequence.joints3d, points, COCO19)


def test_a_name_without_an_id_is_everybody(tmp_path: Path) -> None:
    write(tmp_path, (2, 5, 11))
    assert_everybody(tmp_path, "panoptic", NAME, (f"{NAME}/2", f"{NAME}/5", f"{NAME}/11"))
    assert DATASET.people(tmp_path, f"{NAME}/5") == (f"{NAME}/5",)
    one = read_truths(tmp_path, "panoptic", f"{NAME}/5")
    with pytest.raises(InputError, match=rf"has 1 people, the result 2; .*--sequence {NAME}\)"):
        match_truths([tmp_path / "person1", tmp_path / "person2"], one)


def test_everybody_of_a_sequence_of_one_person(tmp_path: Path) -> None:
    write(tmp_path)
    assert DATASET.people(tmp_path, NAME) == (f"{NAME}/0",)
    with pytest.raises(InputError, match="has no sequence 'other'"):
        DATASET.people(tmp_path, "other")
    with pytest.raises(InputError, match="is no name of a sequence"):
        DATASET.people(tmp_path, "../0")


def test_a_sequence_of_too_many_people_names_one(tmp_path: Path) -> None:
    write(tmp_path, tuple(range(100)))
    with pytest.raises(InputError, match=f"shows 100 people, expected 99 at most; .*{NAME}/0"):
        DATASET.people(tmp_path, NAME)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "no list bodies"),
        ('{"bodies": [{"id": 0}]}', "lacks id or joints19"),
        ('{"bodies": [{"id": 0, "joints19": [1, 2]}]}', "expected 19 x 4"),
        ('{"bodies": [', "not valid JSON"),
    ],
)
def test_frames_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    place = write(tmp_path)
    (place / "hdPose3d_stage1_coco19" / "body3DScene_00000141.json").write_text(text)
    with pytest.raises(InputError, match=message):
        DATASET.read(tmp_path, NAME)


def test_a_person_who_is_twice_in_a_frame(tmp_path: Path) -> None:
    """The second one was taken with no word."""
    write(tmp_path, (2, 2))
    with pytest.raises(InputError, match="two bodies of id 2, expected each person once"):
        DATASET.read(tmp_path, NAME)


@pytest.mark.parametrize("person", ["--0", "-", "\u0663", 5000 * "9", "0x0", "1"])
def test_ids_that_nobody_has(tmp_path: Path, person: str) -> None:
    write(tmp_path)
    with pytest.raises(InputError, match=f"shows 1 people; name one: {NAME}/0"):
        DATASET.read(tmp_path, f"{NAME}/{person}")


def test_calibrations_that_cannot_be_used(tmp_path: Path) -> None:
    place = write(tmp_path)
    path = place / f"calibration_{NAME}.json"
    whole = json.loads(path.read_text())
    path.write_text(json.dumps({"cameras": whole["cameras"][:1]}))
    with pytest.raises(InputError, match="no camera of type hd"):
        DATASET.read(tmp_path, NAME)
    whole["cameras"][1]["R"] = [[1, 0], [0, 1]]
    path.write_text(json.dumps(whole))
    with pytest.raises(InputError, match="rotation R has shape"):
        DATASET.read(tmp_path, NAME)
    path.unlink()
    with pytest.raises(InputError, match="no such file"):
        DATASET.read(tmp_path, NAME)


@pytest.mark.parametrize("name", [3, None, ["a"], 300 * "a", "../b", ""])
def test_names_of_cameras_are_those_of_files(tmp_path: Path, name: object) -> None:
    file = write(tmp_path) / f"calibration_{NAME}.json"
    values = json.loads(file.read_text())
    for camera in values["cameras"]:
        camera["name"] = name
    file.write_text(json.dumps(values))
    with pytest.raises(InputError, match="has no name of letters, digits and dashes"):
        DATASET.read(tmp_path, NAME)
