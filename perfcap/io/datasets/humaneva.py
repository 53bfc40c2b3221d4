"""HumanEva-I: positions as VideoPose3D packs them, cameras of the data set's own ``.cal`` files.

The published motions are MATLAB objects, which the data set's toolbox reads; ``ConvertHumanEva.m``
and ``prepare_data_humaneva.py`` of VideoPose3D make the packed form of them. Stretches in which the
capture failed are cut out, and what remains is called ``chunk0``, ``chunk1`` and so on.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import torch

from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.view import View, make_view
from perfcap.io.datasets.joint_sets import HUMANEVA15, landmarks_in
from perfcap.io.datasets.layout import landmarks_of
from perfcap.io.datasets.positions import PackedPositions
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol
from perfcap.io.files import MEBIBYTE, read_text
from perfcap.metrics import Alignment

_TITLE = "HumanEva-I"
_LAYOUT = "data_3d_humaneva15.npz (VideoPose3D) and S1/Calibration_Data/C1.cal"
_POSITIONS = PackedPositions(_TITLE, "data_3d_humaneva15.npz", _LAYOUT, len(HUMANEVA15))
_CAMERAS = ("C1", "C2", "C3")  # in colour
_SIZE = (480, 640)
_RATE = 60.0
_NUMBERS = 22
_MILLIMETRE = 1e-3


def list_humaneva(folder: Path) -> tuple[str, ...]:
    """Names of the sequences, as ``Validate/S1/Walking 1 chunk0``."""
    return _POSITIONS.names(folder)


def read_humaneva(folder: Path, name: str) -> DatasetSequence:
    """One sequence; without ``.cal`` files it has no cameras."""
    points = _POSITIONS.read(folder, name)
    part, _, action = name.rpartition("/")
    calibration = folder / part.rpartition("/")[2] / "Calibration_Data"
    rig = _cameras(calibration) if calibration.is_dir() else None
    return DatasetSequence(
        dataset="humaneva",
        name=name,
        folder=folder,
        frames=torch.arange(len(points)),
        rate=_RATE,
        joints3d=landmarks_of(points, HUMANEVA15),
        rig=rig,
        action=re.sub(r"\s*\d+( chunk\d+)?$", "", action),
        warnings=(
            "frames are counted from the start of the chunk, not of the video",
            *(() if rig else (f"{calibration}: no such folder, so there are no cameras",)),
        ),
    )


def _cameras(folder: Path) -> CameraRig:
    return make_rig(str(folder), [_view(folder / f"{name}.cal", name) for name in _CAMERAS])


def _view(path: Path, name: str) -> View:
    """A camera: a number a line, f, c, skew, lens (5), rotation (9), translation (mm)."""
    try:
        text = read_text(path, "a .cal file of HumanEva", MEBIBYTE)
        numbers = np.array([float(value) for value in text.split()])
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: holds something that is no number") from error
    if len(numbers) != _NUMBERS:
        raise InputError(
            f"{path}: has {len(numbers)} numbers, expected {_NUMBERS}: f (2), c (2), skew, lens "
            "(5), rotation (9), translation (3)"
        )
    fx, fy, cx, cy, skew = numbers[:5]
    return make_view(
        str(path),
        name,
        intrinsics=[[fx, skew * fx, cx], [0, fy, cy], [0, 0, 1]],
        rotation=numbers[10:19].reshape(3, 3),
        translation=_MILLIMETRE * numbers[19:],
        distortion=numbers[5:10],
        size=_SIZE,
    )


HUMANEVA = Dataset(
    name="humaneva",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=landmarks_in(HUMANEVA15),
        alignments=(Alignment.ABSOLUTE, Alignment.FIRST_FRAME, Alignment.SIMILARITY),
        splits={
            "train": ("Train/S1", "Train/S2", "Train/S3"),
            "validate": ("Validate/S1", "Validate/S2", "Validate/S3"),
        },
        source="Sigal et al. 2010 (absolute); first frame: Rhodin et al. 2016, Table 3",
    ),
    list_names=list_humaneva,
    read_sequence=read_humaneva,
)
