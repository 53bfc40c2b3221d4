"""EMDB (Kaufmann et al. 2023): people outdoors with electromagnetic sensors, a moving phone.

``P1/14_outdoor_climb/P1_14_outdoor_climb_data.pkl`` and ``images/`` beside it. The pickles are read
as plain values (``safe_pickle``). They hold SMPL parameters, not joints: these need
``smpl/male.npz``, ``female.npz`` and ``neutral.npz`` in the data set's folder (``smpl_joints``);
without them there are cameras and joints in the images only.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.view import make_view
from perfcap.io.datasets.joint_sets import SMPL24, landmarks_in
from perfcap.io.datasets.layout import (
    array_of,
    check_name,
    landmarks_of,
    matching,
    present,
    wrong_layout,
)
from perfcap.io.datasets.safe_pickle import read_pickle
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol
from perfcap.io.datasets.smpl_joints import JOINTS, read_smpl_joints
from perfcap.metrics import Alignment

_TITLE = "EMDB"
_LAYOUT = "P1/14_outdoor_climb/P1_14_outdoor_climb_data.pkl, with images/ beside it"
_WHAT = "a sequence of EMDB"
_RATE = 30.0
_GENDERS = ("male", "female", "neutral")


def list_emdb(folder: Path) -> tuple[str, ...]:
    """Names of the sequences, as ``P1/14_outdoor_climb``."""
    found = matching(folder, "P*/*/*_data.pkl")
    if not found:
        raise wrong_layout(folder, _TITLE, "P*/NAME/*_data.pkl", _LAYOUT)
    return tuple(f"{path.parent.parent.name}/{path.parent.name}" for path in found)


def read_emdb(folder: Path, name: str) -> DatasetSequence:
    """One sequence."""
    check_name(folder, _TITLE, name, list_emdb(folder))
    path = matching(folder / name, "*_data.pkl")[0]
    values = read_pickle(path, _WHAT)
    if not isinstance(values, dict):
        raise InputError(f"{path}: is {type(values).__name__}, expected the dictionary of EMDB")
    good = array_of(f"{path}: good_frames_mask", values.get("good_frames_mask"), (None,), "biu")
    frames = len(good)
    joints3d, warning = _joints(folder, path, values, frames)
    pixels = array_of(f"{path}: kp2d", values.get("kp2d"), (frames, JOINTS, 2))
    parts = [part for part in ("emdb1", "emdb2") if values.get(part) is True]
    return DatasetSequence(
        dataset="emdb",
        name=name,
        folder=folder / name,
        frames=torch.arange(frames),
        rate=_RATE,
        joints3d=joints3d,
        rig=_camera(path, values.get("camera"), frames),
        pixels=landmarks_of(pixels, SMPL24)[:, None],
        scored=torch.from_numpy(good > 0),
        action=" ".join(parts),
        videos=present([folder / name / "images"]),
        warnings=(warning,) if warning else (),
    )


def _joints(
    folder: Path, path: Path, values: dict[Any, Any], frames: int
) -> tuple[Tensor | None, str]:
    """Landmarks in the world where there is a body model, else a word about it."""
    gender = values.get("gender")
    if not isinstance(gender, str) or gender not in _GENDERS:  # arrays cannot be compared
        raise InputError(f"{path}: gender is {gender!r:.20}, expected one of {', '.join(_GENDERS)}")
    model = folder / "smpl" / f"{gender}.npz"
    if not model.is_file():
        return None, f"{model}: no such file, so there are no joints in 3D; see docs/datasets.md"
    body = values.get("smpl")
    if not isinstance(body, dict):
        raise InputError(f"{path}: has no dictionary smpl; expected {_WHAT}")
    sizes = {"poses_root": (frames, 3), "poses_body": (frames, 69), "trans": (frames, 3)}
    root, rest, place = (
        torch.from_numpy(array_of(f"{path}: smpl {key}", body.get(key), shape))
        for key, shape in sizes.items()
    )
    betas = body.get("betas")
    flat = betas.reshape(-1) if isinstance(betas, np.ndarray) else betas
    shape = torch.from_numpy(array_of(f"{path}: smpl betas", flat, (None,)))
    rotations = torch.cat((root, rest), -1).reshape(frames, JOINTS, 3)
    points = read_smpl_joints(model).positions(rotations, shape, place)
    return landmarks_of(points.numpy(), SMPL24), ""


def _camera(path: Path, camera: Any, frames: int) -> CameraRig:
    if not isinstance(camera, dict):
        raise InputError(f"{path}: has no dictionary camera; expected {_WHAT}")
    poses = array_of(f"{path}: camera extrinsics", camera.get("extrinsics"), (frames, 4, 4))
    view = make_view(
        f"{path}: camera",
        "phone",
        intrinsics=array_of(f"{path}: camera intrinsics", camera.get("intrinsics"), (3, 3)),
        rotation=poses[:, :3, :3],
        translation=poses[:, :3, 3],
        size=(camera.get("height"), camera.get("width")),
    )
    return make_rig(str(path), [view], fps=_RATE)


EMDB = Dataset(
    name="emdb",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=landmarks_in(SMPL24),
        alignments=(Alignment.ROOT, Alignment.SIMILARITY),
        splits={"emdb1": ("emdb1",), "emdb2": ("emdb2",)},
        source="Kaufmann et al. 2023: 24 joints of SMPL, frames of good_frames_mask",
    ),
    list_names=list_emdb,
    read_sequence=read_emdb,
)
