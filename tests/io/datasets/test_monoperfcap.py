"""The MonoPerfCap benchmark: camera file, surfaces as OFF, silhouettes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import cameras

from perfcap.errors import InputError
from perfcap.io.datasets import find_dataset
from perfcap.io.datasets.monoperfcap import read_off, read_surface

DATASET = find_dataset("monoperfcap")
SQUARE = "OFF\n# a square\n4 1 0\n0 0 0\n1000 0 0\n1000 1000 0\n0 1000 0\n4 0 1 2 3\n"


def write(folder: Path) -> Path:
    place = folder / "Pablo_outdoor"
    (place / "ground_truth").mkdir(parents=True)
    (place / "images").mkdir()
    inner, outer = np.eye(4), np.eye(4)
    camera = cameras(1, 1500)
    inner[:3, :3], outer[:3, :3] = camera.intrinsics[0], camera.rotation[0]
    outer[:3, 3] = 1000 * camera.translation[0]
    rows = [" ".join(repr(float(x)) for x in m.ravel()) for m in (inner, outer)]
    (place / "calib.txt").write_text(
        "Skeletool Camera Calibration File V1.0\nname 0\n"
        f"intrinsic {rows[0]}\nextrinsic {rows[1]}\nradial 0\n"
    )
    for frame in range(3):
        (place / "ground_truth" / f"mesh_{frame:04d}.off").write_text(SQUARE)
    return place


def test_surfaces_and_camera(tmp_path: Path) -> None:
    write(tmp_path)
    assert DATASET.sequences(tmp_path) == ("Pablo_outdoor",)
    sequence = DATASET.read(tmp_path, "Pablo_outdoor")
    assert sequence.joints3d is None and sequence.rig is not None
    torch.testing.assert_close(sequence.rig.cameras.translation, cameras(1).translation)
    assert sequence.rig.cameras.size == ((1080, 1920),)
    assert len(sequence.meshes) == len(sequence.frames) == 3
    vertices, faces = read_surface(sequence.meshes[0])
    assert vertices.max() == 1.0 and faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert [path.name for path in sequence.videos] == ["images"]


@pytest.mark.parametrize("terms", ["1", "2 -0.21 0.13", "1e-3"])
def test_distortions_that_are_left_out_are_named(tmp_path: Path, terms: str) -> None:
    place = write(tmp_path)
    assert not DATASET.read(tmp_path, place.name).rig.warnings
    calibration = place / "calib.txt"
    calibration.write_text(calibration.read_text().replace("radial 0", f"radial {terms}"))
    warnings = DATASET.read(tmp_path, place.name).warnings
    assert "camera 0 has a radial distortion" in warnings[-1]


def test_files_are_of_the_frames_of_their_numbers(tmp_path: Path) -> None:
    place = write(tmp_path)
    truth = place / "ground_truth"
    (truth / "mesh_0001.off").unlink()
    (sequence, note) = _read(tmp_path)
    assert sequence == [0, 2] and "there is none of 1 frame between" in note
    for number in range(99, 104):  # images from 99 on
        (place / "images" / f"image_{number:06d}.jpg").touch()
    assert _read(tmp_path)[0] == [0, 2]  # of no images: counted from the first
    for number, name in ((101, "mesh_0000.off"), (103, "mesh_0002.off")):
        (truth / name).rename(truth / f"mesh_{number}.off")
    frames, note = _read(tmp_path)
    assert frames == [2, 4] and "of the images of its numbers" in note
    (truth / "mesh_101.off").rename(truth / "first.off")
    frames, note = _read(tmp_path)
    assert frames == [0, 1] and "its names have no numbers" in note


def _read(folder: Path) -> tuple[list[int], str]:
    sequence = DATASET.read(folder, "Pablo_outdoor")
    (note,) = sequence.warnings
    return sequence.frames.tolist(), note


def test_surfaces_and_silhouettes_are_of_the_same_frames(tmp_path: Path) -> None:
    truth = write(tmp_path) / "ground_truth"
    for number in range(3):
        (truth / f"mask_{number:04d}.png").touch()
    assert len(DATASET.read(tmp_path, "Pablo_outdoor").masks) == 3
    (truth / "mask_0001.png").unlink()
    with pytest.raises(InputError, match=r"3 \*\.off and 2 \*\.png of other frames"):
        DATASET.read(tmp_path, "Pablo_outdoor")


def test_without_truth(tmp_path: Path) -> None:
    place = write(tmp_path)
    for path in (place / "ground_truth").iterdir():
        path.unlink()
    sequence = DATASET.read(tmp_path, "Pablo_outdoor")
    assert not sequence.meshes and "nothing to compare with" in sequence.warnings[0]


@pytest.mark.parametrize(
    "text",
    [
        "solid",
        "OFF\n",
        "OFF\n4 1 0\n0 0 0\n",
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n",
        "OFF\n3 1 0\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n",
        "OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n",
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n",
        "OFF\n99999999999 1 0\n0 0 0\n",
        "OFF\n3 1 0\n0 0 0\n1 x 0\n0 1 0\n3 0 1 2\n",
    ],
)
def test_meshes_that_cannot_be_used(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.off").write_text(text)
    with pytest.raises(InputError, match=r"a\.off") as error:
        read_off(tmp_path / "a.off")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing\n", "no line 'intrinsic'"),
        ("intrinsic 1 2 3\n", "extrinsic has 0 numbers|intrinsic has 3"),
        ("name 0\nanimated 1\nintrinsic 1\n", "is animated"),
        ("name 0\nsize nan 1080\nintrinsic 1\n", "size holds NaN or infinity"),
    ],
)
def test_camera_files_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    (write(tmp_path) / "calib.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        DATASET.read(tmp_path, "Pablo_outdoor")
