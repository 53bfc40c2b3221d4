"""Human3.6M: positions as VideoPose3D packs them, cameras of the data set's own ``metadata.xml``.

The published positions are CDF files, which need a library of their own; the packed form is what
most people pass on, and ``prepare_data_h36m.py`` of VideoPose3D makes it of the CDF files.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.view import View, make_view
from perfcap.io.datasets.joint_sets import H36M32, landmarks_in
from perfcap.io.datasets.layout import landmarks_of, present
from perfcap.io.datasets.positions import PackedPositions
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol
from perfcap.io.files import MEBIBYTE, read_text
from perfcap.metrics import Alignment

_TITLE = "Human3.6M"
_LAYOUT = "data_3d_h36m.npz (VideoPose3D) and metadata.xml (with the data set)"
_POSITIONS = PackedPositions(_TITLE, "data_3d_h36m.npz", _LAYOUT, len(H36M32))
_METADATA = "metadata.xml"
_RATE = 50.0
_SUBJECTS = 11
# serial numbers, and image sizes (height, width)
_CAMERAS = {
    "54138969": (1002, 1000),
    "55011271": (1000, 1000),
    "58860488": (1000, 1000),
    "60457274": (1002, 1000),
}
_EXTRINSICS, _INTRINSICS = 6, 9  # numbers a camera and subject, a camera
_NUMBERS = re.compile(r"<w0>\s*\[([^\]<]*)\]\s*</w0>")
_MILLIMETRE = 1e-3


def list_human36m(folder: Path) -> tuple[str, ...]:
    """Names of the sequences, as ``S9/Directions 1``."""
    return _POSITIONS.names(folder)


def read_human36m(folder: Path, name: str) -> DatasetSequence:
    """One sequence; without ``metadata.xml`` it has no cameras."""
    points = _POSITIONS.read(folder, name)
    subject, _, action = name.partition("/")
    metadata = folder / _METADATA
    rig = _cameras(metadata, subject) if metadata.is_file() else None
    return DatasetSequence(
        dataset="human36m",
        name=name,
        folder=folder,
        frames=torch.arange(len(points)),
        rate=_RATE,
        joints3d=landmarks_of(points, H36M32),
        rig=rig,
        action=re.sub(r"\s*\d+$", "", action),
        videos=present([folder / subject / "Videos" / f"{action}.{c}.mp4" for c in _CAMERAS]),
        warnings=() if rig else (f"{folder}: has no {_METADATA}, so there are no cameras",),
    )


def _cameras(path: Path, subject: str) -> CameraRig:
    """The four cameras as they stood for a subject."""
    match = _NUMBERS.search(read_text(path, "metadata.xml of Human3.6M", 64 * MEBIBYTE))
    try:
        numbers = np.array([float(text) for text in match[1].split()]) if match else np.zeros(0)
    except ValueError as error:
        raise InputError(f"{path}: w0 holds something that is no number") from error
    count = len(_CAMERAS) * (_SUBJECTS * _EXTRINSICS + _INTRINSICS)
    if len(numbers) != count or not re.fullmatch(r"S([1-9]|1[01])", subject):
        raise InputError(
            f"{path}: has {len(numbers)} numbers in w0 for subject {subject!r:.20}, expected "
            f"{count} for S1 to S11"
        )
    split = len(_CAMERAS) * _SUBJECTS * _EXTRINSICS
    outer = numbers[:split].reshape(len(_CAMERAS), _SUBJECTS, _EXTRINSICS)
    inner = numbers[split:].reshape(len(_CAMERAS), _INTRINSICS)
    row = int(subject[1:]) - 1
    views = [
        _view(f"{path}: camera {serial}", serial, outer[i, row], inner[i])
        for i, serial in enumerate(_CAMERAS)
    ]
    return make_rig(str(path), views, fps=_RATE)


def _view(where: str, serial: str, outer: NDArray[np.float64], inner: NDArray[np.float64]) -> View:
    """A camera of its numbers: turns about x, y, z and the centre (mm); f, c, k1 to k3, p1, p2.

    The tangential part of Human3.6M's lens is half of OpenCV's in one of two terms, which moves
    pixels by less than 0.3.
    """
    turns = rotvec_to_matrix(torch.diag(torch.from_numpy(outer[:3])))  # about each axis
    rotation = (turns[0] @ turns[1] @ turns[2]).numpy()
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = inner
    return make_view(
        where,
        serial,
        intrinsics=[[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
        rotation=rotation,
        translation=-_MILLIMETRE * rotation @ outer[3:],
        distortion=[k1, k2, p1, p2, k3],
        size=_CAMERAS[serial],
    )


HUMAN36M = Dataset(
    name="human36m",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=tuple(j for j in landmarks_in(H36M32) if not j.endswith("toe")),
        alignments=(Alignment.ROOT, Alignment.SIMILARITY),
        splits={
            "train": ("S1", "S5", "S6", "S7", "S8"),
            "test": ("S9", "S11"),
        },
        source="Ionescu et al. 2014; protocols 1 (root) and 2 (similarity) of Martinez et al. 2017",
    ),
    list_names=list_human36m,
    read_sequence=read_human36m,
)
