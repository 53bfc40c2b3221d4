"""MPI-INF-3DHP: training sequences in 14 views, test sequences of MATLAB 7.3."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import FRAMES, assert_landmarks, person
from scipy.io import savemat
from synthetic import cameras as circle

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.datasets import find_dataset
from perfcap.io.datasets.joint_sets import MPI17, MPI28

DATASET = find_dataset("mpi_inf_3dhp")


def ring() -> Camera:
    """14 cameras."""
    return circle(14, size=2048)


def write_calibration(path: Path, camera: Camera) -> None:
    lines = ["Skeletool Camera Calibration File V1.0"]
    for view in range(camera.views):
        inner, outer = np.eye(4), np.eye(4)
        inner[:3, :3] = camera.intrinsics[view]
        outer[:3, :3] = camera.rotation[view]
        outer[:3, 3] = 1000 * camera.translation[view]
        lines += [f"name          {view}", "  sensor      10 10", "  size        2048 2048"]
        lines += ["  animated    0"]
        for name, matrix in (("intrinsic", inner), ("extrinsic", outer)):
            lines.append(f"  {name}   " + " ".join(repr(float(x)) for x in matrix.ravel()))
        lines.append("  radial      0")
    path.write_text("\n".join(lines) + "\n")


def cells(arrays: list[np.ndarray]) -> np.ndarray:
    found = np.empty((len(arrays), 1), dtype=object)
    for index, array in enumerate(arrays):
        found[index, 0] = array
    return found


@pytest.fixture
def training(tmp_path: Path) -> Path:
    folder = tmp_path / "S1" / "Seq1"
    folder.mkdir(parents=True)
    points = torch.from_numpy(person(MPI28))
    local = ring().to_camera(points)
    pixels = ring().project(points)
    annot3 = [1000 * local[:, view].reshape(FRAMES, -1).numpy() for view in range(14)]
    annot2 = [pixels[:, view].reshape(FRAMES, -1).numpy() for view in range(14)]
    values = {
        "annot2": cells(annot2),
        "annot3": cells(annot3),
        "frames": np.arange(FRAMES)[:, None],
    }
    savemat(folder / "annot.mat", values)
    write_calibration(folder / "camera.calibration", ring())
    return tmp_path


def test_training(training: Path) -> None:
    assert DATASET.sequences(training) == ("S1/Seq1",)
    sequence = DATASET.read(training, "S1/Seq1")
    assert sequence.joints3d is not None and sequence.rig is not None
    assert_landmarks(sequence.joints3d, person(MPI28), MPI28)
    torch.testing.assert_close(sequence.rig.cameras.translation, ring().translation)
    assert sequence.pixels is not None and sequence.pixels.shape == (FRAMES, 14, 16, 2)
    torch.testing.assert_close(
        sequence.pixels, sequence.rig.cameras.project(sequence.joints3d), atol=1e-6, rtol=1e-9
    )
    assert sequence.rate == 25.0 and len(DATASET.protocol.joints) == 14


def test_training_files_that_cannot_be_used(training: Path) -> None:
    folder = training / "S1" / "Seq1"
    calibration = (folder / "camera.calibration").read_text()
    (folder / "camera.calibration").write_text(calibration.split("name          3")[0])
    with pytest.raises(InputError, match="has 3 cameras, expected 14"):
        DATASET.read(training, "S1/Seq1")
    (folder / "camera.calibration").write_text(calibration.replace("extrinsic ", "extrinsic x"))
    with pytest.raises(InputError, match="extrinsic"):
        DATASET.read(training, "S1/Seq1")
    (folder / "camera.calibration").write_text(calibration)
    savemat(folder / "annot.mat", {"annot2": np.zeros((3, 4))})
    with pytest.raises(InputError, match="annot2 is float64"):
        DATASET.read(training, "S1/Seq1")
    (folder / "annot.mat").write_bytes(b"MATLAB 5.0 MAT-file, and then nonsense" * 20)
    with pytest.raises(InputError, match="no readable MATLAB file"):
        DATASET.read(training, "S1/Seq1")
    (folder / "annot.mat").write_bytes(bytes(400))
    with pytest.raises(InputError, match="no readable MATLAB file"):
        DATASET.read(training, "S1/Seq1")


def write_test(folder: Path) -> np.ndarray:
    """TS1 as MATLAB 7.3 lies in HDF5, and its camera file."""
    h5py = pytest.importorskip("h5py", reason="test sequences are HDF5 and need h5py")
    points = person(MPI17) + np.array([0, 0, 3])
    place = folder / "mpi_inf_3dhp_test_set" / "TS1"
    place.mkdir(parents=True)
    with h5py.File(place / "annot_data.mat", "w", userblock_size=512) as file:
        file["annot3"] = 1000 * points[:, None]
        file["annot2"] = 1500 * points[:, None, :, :2] / points[:, None, :, 2:] + 1024
        file["valid_frame"] = np.array([[1.0], [1], [0], [1], [1]])
        file["univ_annot3"] = points[:, None]
    calibration = folder / "mpi_inf_3dhp_test_set" / "test_util" / "camera_calibration"
    calibration.mkdir(parents=True)
    (calibration / "ts1-4cameras.calib").write_text(
        "tc camera calibration v0.3\ncamera\t0\tvnect\n\tframe\t0\n\t\tsensorSize\t10 10\n"
        "\t\tfocalLength\t7.32421875\n\t\tpixelAspect\t1\n\t\tcenterOffset\t0 0\n"
        "\t\tdistortionModel\tOpenCV\n\t\tdistortion\t0 0 0 0 0\n"
    )
    return points


def test_test_set(tmp_path: Path) -> None:
    points = write_test(tmp_path)
    assert DATASET.sequences(tmp_path) == ("TS1",)
    sequence = DATASET.read(tmp_path, "TS1")
    assert sequence.joints3d is not None and sequence.rig is not None
    assert_landmarks(sequence.joints3d, points, MPI17)
    assert sequence.counted(DATASET.protocol).tolist() == [True, True, False, True, True]
    projected = sequence.rig.cameras.project(sequence.joints3d.nan_to_num(1.0))
    known = sequence.joints3d.isfinite().all(-1)[:, None]
    assert sequence.pixels is not None
    torch.testing.assert_close(projected[known], sequence.pixels[known])


@pytest.mark.parametrize(
    ("before", "after"),
    [("sensorSize\t10 10", "sensorSize\t0 0"), ("centerOffset\t0 0", "centerOffset\t0")],
)
def test_cameras_of_the_test_set_that_cannot_be_used(
    tmp_path: Path, before: str, after: str
) -> None:
    write_test(tmp_path)
    (path,) = tmp_path.rglob("*.calib")
    path.write_text(path.read_text().replace(before, after))
    with pytest.raises(InputError, match="lacks sensorSize, focalLength or centerOffset"):
        DATASET.read(tmp_path, "TS1")


def test_links_out_of_the_file_are_refused(tmp_path: Path) -> None:
    """HDF5 can refer to other files of the machine."""
    h5py = pytest.importorskip("h5py", reason="test sequences are HDF5 and need h5py")
    write_test(tmp_path)
    path = tmp_path / "mpi_inf_3dhp_test_set" / "TS1" / "annot_data.mat"
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["x"] = np.zeros((5, 1, 17, 3))
    with h5py.File(path, "a") as file:
        del file["annot3"]
        file["annot3"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "x")
    with pytest.raises(InputError, match="annot3 is no array that lies in the file"):
        DATASET.read(tmp_path, "TS1")
    with h5py.File(path, "a") as file:
        del file["annot3"]
        (tmp_path / "raw").write_bytes(bytes(8 * 5 * 17 * 3))
        file.create_dataset(
            "annot3",
            shape=(5, 1, 17, 3),
            dtype="f8",
            external=[(str(tmp_path / "raw"), 0, h5py.h5f.UNLIMITED)],
        )
    with pytest.raises(InputError, match="annot3 is no array that lies in the file"):
        DATASET.read(tmp_path, "TS1")


@pytest.mark.parametrize("name", ["annot3", "annot2", "valid_frame"])
def test_a_single_number_is_no_array_of_frames(tmp_path: Path, name: str) -> None:
    h5py = pytest.importorskip("h5py", reason="test sequences are HDF5 and need h5py")
    write_test(tmp_path)
    path = tmp_path / "mpi_inf_3dhp_test_set" / "TS1" / "annot_data.mat"
    with h5py.File(path, "a") as file:
        del file[name]
        file[name] = 1.0
    with pytest.raises(InputError, match=name):
        DATASET.read(tmp_path, "TS1")
