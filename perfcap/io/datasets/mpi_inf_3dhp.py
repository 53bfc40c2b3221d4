"""MPI-INF-3DHP (Mehta et al. 2017): eight subjects in 14 views, and a test set in one view each.

Training: ``S1/Seq1/annot.mat`` and ``S1/Seq1/camera.calibration``. Test:
``mpi_inf_3dhp_test_set/TS1/annot_data.mat``, of MATLAB 7.3, and
``mpi_inf_3dhp_test_set/test_util/camera_calibration/*.calib``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.view import make_view
from perfcap.io.datasets.joint_sets import MPI17, MPI28, landmarks_in
from perfcap.io.datasets.layout import (
    array_of,
    check_name,
    landmarks_of,
    matching,
    present,
    wrong_layout,
)
from perfcap.io.datasets.matlab import is_hdf5, read_hdf5, read_mat
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol
from perfcap.io.datasets.skeletool import read_skeletool
from perfcap.io.files import MEBIBYTE, read_text
from perfcap.metrics import Alignment

_TITLE = "MPI-INF-3DHP"
_LAYOUT = "S1/Seq1/annot.mat, or mpi_inf_3dhp_test_set/TS1/annot_data.mat"
_TRAIN, _TEST = "S*/Seq*/annot.mat", "TS*/annot_data.mat"
_TEST_FOLDER = "mpi_inf_3dhp_test_set"
_WHAT_TRAIN = "annot.mat: cells annot2 and annot3, one a camera"
_WHAT_TEST = "annot_data.mat: annot2, annot3, valid_frame"
_VIEWS = 14
_SLOW, _FAST, _LONG = 25.0, 50.0, 10_000  # frames a second; the long sequences are the fast ones
_MILLIMETRE = 1e-3
# image sizes (height, width) of the test set, and which camera file goes with it
_INDOORS, _OUTDOORS = (2048, 2048), (1080, 1920)
_TEST_CAMERAS = {
    **dict.fromkeys(("TS1", "TS2", "TS3", "TS4"), ("ts1-4cameras.calib", _INDOORS)),
    **dict.fromkeys(("TS5", "TS6"), ("ts5-6cameras.calib", _OUTDOORS)),
}


def list_mpi_inf_3dhp(folder: Path) -> tuple[str, ...]:
    """Names of the sequences: ``S1/Seq1`` and ``TS1``."""
    train = [f"{path.parent.parent.name}/{path.parent.name}" for path in matching(folder, _TRAIN)]
    test = [path.parent.name for path in matching(_test_folder(folder), _TEST)]
    if not train and not test:
        raise wrong_layout(folder, _TITLE, _LAYOUT, _LAYOUT)
    return (*train, *test)


def read_mpi_inf_3dhp(folder: Path, name: str) -> DatasetSequence:
    """One sequence: in the world of its cameras, or, of the test set, in that of its camera."""
    check_name(folder, _TITLE, name, list_mpi_inf_3dhp(folder))
    if name.startswith("TS"):
        return _read_test(_test_folder(folder), name)
    return _read_train(folder / name, name)


def _read_train(folder: Path, name: str) -> DatasetSequence:
    path = folder / "annot.mat"
    values = read_mat(path, ("annot2", "annot3"), _WHAT_TRAIN)
    rig = read_skeletool(folder / "camera.calibration")
    if len(rig.names) != _VIEWS:
        raise InputError(
            f"{folder / 'camera.calibration'}: has {len(rig.names)} cameras, expected {_VIEWS}"
        )
    cells = {key: _cells(path, key, values.get(key)) for key in ("annot2", "annot3")}
    frames = len(cells["annot3"][0])
    local = array_of(f"{path}: annot3", cells["annot3"][0], (frames, 3 * len(MPI28)))
    landmarks = landmarks_of(local.reshape(frames, -1, 3), MPI28, _MILLIMETRE)
    camera = rig.cameras
    # x_camera = R x_world + t, for rows
    world = (landmarks - camera.translation[0]) @ camera.rotation[0]
    pixels = [
        landmarks_of(
            array_of(f"{path}: annot2", view, (frames, 2 * len(MPI28))).reshape(frames, -1, 2),
            MPI28,
        )
        for view in cells["annot2"]
    ]
    return DatasetSequence(
        dataset="mpi_inf_3dhp",
        name=name,
        folder=folder,
        frames=torch.arange(frames),
        rate=_FAST if frames > _LONG else _SLOW,
        rate_known=False,
        joints3d=world,
        rig=rig,
        pixels=torch.stack(pixels, 1),
        videos=present([folder / "imageSequence" / f"video_{i}.avi" for i in range(_VIEWS)]),
        warnings=rig.warnings,
    )


def _cells(path: Path, key: str, values: Any) -> list[Any]:
    """One array a camera."""
    if values is None or values.dtype != object or values.size != _VIEWS:
        found = "missing" if values is None else f"{values.dtype} {values.shape}"
        raise InputError(f"{path}: {key} is {found}, expected {_VIEWS} cells, one a camera")
    return list(values.reshape(-1))


def _read_test(folder: Path, name: str) -> DatasetSequence:
    path = folder / name / "annot_data.mat"
    names = ("annot2", "annot3", "valid_frame")
    read = read_hdf5 if is_hdf5(path) else read_mat
    values = {key: _reversed(array) for key, array in read(path, names, _WHAT_TEST).items()}
    given = values.get("annot3")
    frames = len(given) if given is not None and given.ndim else 0
    shape = (frames, 1, len(MPI17))
    local = array_of(f"{path}: annot3", values.get("annot3"), (*shape, 3))[:, 0]
    pixels = array_of(f"{path}: annot2", values.get("annot2"), (*shape, 2))
    valid = values.get("valid_frame", np.ones(frames)).reshape(-1)
    if len(valid) != frames:
        raise InputError(f"{path}: valid_frame has {len(valid)} frames, annot3 {frames}")
    calibration = folder / "test_util" / "camera_calibration"
    rig = _test_camera(calibration, name) if calibration.is_dir() else None
    return DatasetSequence(
        dataset="mpi_inf_3dhp",
        name=name,
        folder=folder / name,
        frames=torch.arange(frames),
        rate=_SLOW,
        rate_known=False,
        joints3d=landmarks_of(local, MPI17, _MILLIMETRE),
        rig=rig,
        pixels=landmarks_of(pixels, MPI17),
        scored=torch.from_numpy(valid != 0),
        videos=present([folder / name / "imageSequence"]),
        warnings=(
            "the rate of the test set is taken to be 25 frames a second",
            *(() if rig else (f"{calibration}: no such folder, so there is no camera",)),
        ),
    )


def _reversed(array: NDArray[Any]) -> NDArray[Any]:
    """As HDF5 has it, (F, 1, J, d), also from (d, J, 1, F)."""
    backwards = array.ndim == 4 and array.shape[0] in (2, 3) and array.shape[1] == len(MPI17)
    return array.transpose() if backwards else array


def _test_camera(folder: Path, name: str) -> CameraRig:
    """The camera of a test sequence, which is also its world.

    Lengths are in millimetres on the sensor; the centre is given from the middle of the image.
    """
    if name not in _TEST_CAMERAS:
        raise InputError(f"{folder}: knows the cameras of TS1 to TS6, not of {name!r:.20}")
    file, (height, width) = _TEST_CAMERAS[name]
    path = folder / file
    lines = [line.split() for line in read_text(path, "a .calib file", MEBIBYTE).splitlines()]
    words = {line[0]: line[1:] for line in lines if line}
    try:
        wide, high = (float(value) for value in words["sensorSize"][:2])
        focal, aspect = float(words["focalLength"][0]), float(words.get("pixelAspect", ["1"])[0])
        right, down = (float(value) for value in words.get("centerOffset", ["0", "0"])[:2])
        scale = (width / wide, height / high)
    except (KeyError, ValueError, IndexError, ZeroDivisionError) as error:
        raise InputError(
            f"{path}: lacks sensorSize, focalLength or centerOffset ({error}); expected the "
            "camera file of the test set"
        ) from error
    view = make_view(
        str(path),
        name,
        intrinsics=[
            [focal * scale[0], 0, width / 2 + right * scale[0]],
            [0, focal * scale[1] * aspect, height / 2 + down * scale[1]],
            [0, 0, 1],
        ],
        rotation=np.eye(3),
        translation=np.zeros(3),
        size=(height, width),
    )
    return make_rig(str(path), [view])


def _test_folder(folder: Path) -> Path:
    inner = folder / _TEST_FOLDER
    return inner if inner.is_dir() else folder


MPI_INF_3DHP = Dataset(
    name="mpi_inf_3dhp",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=landmarks_in(MPI17),
        alignments=(Alignment.ROOT, Alignment.SIMILARITY),
        splits={
            "train": tuple(f"S{i}" for i in range(1, 9)),
            "test": tuple(f"TS{i}" for i in range(1, 7)),
        },
        source="Mehta et al. 2017: 3DPCK at 150 mm and its area under the curve, roots aligned",
    ),
    list_names=list_mpi_inf_3dhp,
    read_sequence=read_mpi_inf_3dhp,
)
