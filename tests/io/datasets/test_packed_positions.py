"""Human3.6M and HumanEva as VideoPose3D packs them, with cameras of the data sets' own files."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import FRAMES, Floats, assert_landmarks, cameras, landmark, person

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.datasets import find_dataset
from perfcap.io.datasets.joint_sets import H36M32, HUMANEVA15
from perfcap.metrics import Alignment

HUMAN36M, HUMANEVA = find_dataset("human36m"), find_dataset("humaneva")


def pack(path: Path, positions: object) -> None:
    np.savez_compressed(path, positions_3d=np.array(positions, dtype=object))


def angles(rotation: Floats) -> Floats:
    """Turns about x, then y, then z that multiply to a rotation."""
    y = np.arcsin(rotation[0, 2])
    x = np.arctan2(-rotation[1, 2], rotation[2, 2])
    z = np.arctan2(-rotation[0, 1], rotation[0, 0])
    return np.array([x, y, z])


def write_metadata(path: Path, camera: Camera, subject: int) -> None:
    """Cameras of one subject as in metadata.xml; those of the others are zeros."""
    outer = np.zeros((4, 11, 6))
    inner = np.zeros((4, 9))
    for view in range(4):
        rotation = camera.rotation[view].numpy()
        centre = -rotation.T @ camera.translation[view].numpy()
        outer[view, subject - 1] = [*angles(rotation), *(1000 * centre)]
        k = camera.intrinsics[view].numpy()
        inner[view] = [k[0, 0], k[1, 1], k[0, 2], k[1, 2], -0.2, 0.2, -0.01, 0.001, -0.002]
    numbers = " ".join(repr(float(n)) for n in [*outer.ravel(), *inner.ravel()])
    path.write_text(f"<metadata><mapping/><w0>[{numbers}]</w0></metadata>")


@pytest.fixture
def human36m(tmp_path: Path) -> Path:
    points = {
        "S9": {"Directions 1": person(H36M32).astype(np.float32)},
        "S11": {"Walking": person(H36M32, 3, 1)},
    }
    pack(tmp_path / "data_3d_h36m.npz", points)
    return tmp_path


def test_human36m(human36m: Path) -> None:
    write_metadata(human36m / "metadata.xml", cameras(4), 9)
    assert HUMAN36M.sequences(human36m) == ("S9/Directions 1", "S11/Walking")
    sequence = HUMAN36M.read(human36m, "S9/Directions 1")
    points = person(H36M32).astype(np.float32).astype(float)
    assert sequence.joints3d is not None and sequence.rig is not None
    assert_landmarks(sequence.joints3d, points, H36M32)
    assert (sequence.rate, sequence.action, len(sequence.frames)) == (50.0, "Directions", FRAMES)
    known, found = cameras(4), sequence.rig.cameras
    torch.testing.assert_close(found.rotation, known.rotation)
    torch.testing.assert_close(found.translation, known.translation)
    assert found.distortion is not None
    assert found.distortion[0].tolist() == [-0.2, 0.2, 0.001, -0.002, -0.01]
    assert found.size[0] == (1002, 1000) and sequence.rig.names[3] == "60457274"
    pixels = sequence.joints2d()
    assert pixels is not None and pixels.shape == (FRAMES, 4, 16, 2)
    assert pixels.isfinite().all()
    assert HUMAN36M.protocol.splits["test"] == ("S9", "S11")
    assert "r_toe" not in HUMAN36M.protocol.joints and len(HUMAN36M.protocol.joints) == 14


def test_human36m_without_cameras(human36m: Path) -> None:
    sequence = HUMAN36M.read(human36m, "S11/Walking")
    assert sequence.rig is None and sequence.joints2d() is None
    assert "metadata.xml" in sequence.warnings[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<w0>[1 2 3]</w0>", "has 3 numbers in w0"),
        ("<w0>[1 x 3]</w0>", "no number"),
        ("<!DOCTYPE x [<!ENTITY a 'b'>]>", "has 0 numbers"),
    ],
)
def test_human36m_cameras_that_cannot_be_used(human36m: Path, text: str, message: str) -> None:
    (human36m / "metadata.xml").write_text(text)
    with pytest.raises(InputError, match=message):
        HUMAN36M.read(human36m, "S9/Directions 1")


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        ([1, 2], "expected positions_3d"),
        ({}, "no action"),
        ({"S9": [1]}, "subject S9 is list"),
        ({"S9": {"Walking": np.zeros((4, 17, 3))}}, "(4, 17, 3)"),
        ({"S9": {"Walking": np.zeros((0, 32, 3))}}, "(0, 32, 3)"),
        ({"S9": {"Walking": "text"}}, "is str"),
    ],
)
def test_positions_of_something_else(tmp_path: Path, positions: object, message: str) -> None:
    pack(tmp_path / "data_3d_h36m.npz", positions)
    with pytest.raises(InputError) as error:
        HUMAN36M.read(tmp_path, "S9/Walking")
    assert message in str(error.value) and "\n" not in str(error.value)


def test_damaged_archives(human36m: Path) -> None:
    """Bytes turned over anywhere: values or one line."""
    path = human36m / "data_3d_h36m.npz"
    whole = path.read_bytes()
    dice = random.Random(0)
    refused = 0
    for _ in range(60):
        data = bytearray(whole)
        for _ in range(4):
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        path.write_bytes(bytes(data))
        try:
            HUMAN36M.read(human36m, "S9/Directions 1")
        except InputError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 30


@pytest.mark.parametrize("name", ["S9/Sitting", "S9", "", "../S9", "S9/../S11"])
def test_names_that_are_not_there(human36m: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"has no sequence|is no name"):
        HUMAN36M.read(human36m, name)


def write_cal(path: Path, camera: Camera, view: int, lens: list[float]) -> None:
    """A number a line: f, c, skew, lens, rotation, translation in mm."""
    k = camera.intrinsics[view].numpy()
    numbers = [k[0, 0], k[1, 1], k[0, 2], k[1, 2], 0.0, *lens]
    numbers += [*camera.rotation[view].numpy().ravel(), *(1000 * camera.translation[view].numpy())]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{number!r}\n" for number in map(float, numbers)))


def test_humaneva(tmp_path: Path) -> None:
    points = person(HUMANEVA15)
    pack(tmp_path / "data_3d_humaneva15.npz", {"Validate/S1": {"Walking 1 chunk0": points}})
    lens = [-0.28, 0.1, -0.001, 0.002, 0.0]
    for view in range(3):
        path = tmp_path / "S1" / "Calibration_Data" / f"C{view + 1}.cal"
        write_cal(path, cameras(3, 480), view, lens)
    (name,) = HUMANEVA.sequences(tmp_path)
    assert name == "Validate/S1/Walking 1 chunk0"
    sequence = HUMANEVA.read(tmp_path, name)
    assert sequence.joints3d is not None and sequence.rig is not None
    assert_landmarks(sequence.joints3d, points, HUMANEVA15)
    np.testing.assert_allclose(sequence.joints3d[:, 1], landmark(points, HUMANEVA15, "thorax"))
    assert (sequence.action, sequence.rate) == ("Walking", 60.0)
    torch.testing.assert_close(sequence.rig.cameras.translation, cameras(3, 480).translation)
    assert sequence.rig.cameras.distortion is not None
    assert sequence.rig.cameras.distortion[2].tolist() == lens
    assert Alignment.FIRST_FRAME in HUMANEVA.protocol.alignments
    path.write_text("1 2 3")
    with pytest.raises(InputError, match="has 3 numbers, expected 22"):
        HUMANEVA.read(tmp_path, name)


def test_turns_are_taken_about_x_then_y_then_z() -> None:
    """The helper of these tests undoes what the reader does."""
    turns = rotvec_to_matrix(torch.diag(torch.tensor([0.3, -0.5, 0.9], dtype=torch.float64)))
    found = angles((turns[0] @ turns[1] @ turns[2]).numpy())
    np.testing.assert_allclose(found, [0.3, -0.5, 0.9])
