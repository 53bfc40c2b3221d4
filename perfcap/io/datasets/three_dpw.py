"""3DPW (von Marcard et al. 2018): people outdoors, filmed with a moving phone.

``sequenceFiles/{train,validation,test}/NAME.pkl`` and ``imageFiles/NAME/``. The pickles are read as
plain values (``safe_pickle``). A sequence holds one or two people: ``NAME/0``, ``NAME/1``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.joint_set import COCO18
from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.view import make_view
from perfcap.io.datasets.joint_sets import SMPL24, landmarks_in
from perfcap.io.datasets.layout import array_of, landmarks_of, matching, present, wrong_layout
from perfcap.io.datasets.safe_pickle import read_pickle
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol
from perfcap.metrics import Alignment

_TITLE = "3DPW"
_LAYOUT = "sequenceFiles/{train,validation,test}/NAME.pkl and imageFiles/NAME/"
_WHAT = "a sequence of 3DPW"
_RATE = 30.0
_MAX_PEOPLE = 8


def list_three_dpw(folder: Path) -> tuple[str, ...]:
    """Names of the sequences, without the number of the person that follows."""
    names = [path.stem for path in matching(folder, "sequenceFiles/*/*.pkl")]
    if not names:
        raise wrong_layout(folder, _TITLE, "sequenceFiles/*/NAME.pkl", _LAYOUT)
    return tuple(names)


def read_three_dpw(folder: Path, name: str) -> DatasetSequence:
    """One person of a sequence, ``NAME/0``; ``NAME`` alone where there is one."""
    base, _, number = name.partition("/")
    path, values = _take(folder, base)
    people, person = _person(path, values, number)
    joints = _of(path, values, "jointPositions", person, (None, 3 * len(SMPL24)))
    frames = len(joints)
    others = {
        f"{base}/{i}": _of(path, values, "jointPositions", i, (frames, 3 * len(SMPL24)))
        for i in range(people)
        if i != person
    }
    detections = _of(path, values, "poses2d", person, (frames, 3, len(COCO18)))
    valid = _of(path, values, "campose_valid", person, (frames,))
    return DatasetSequence(
        dataset="3dpw",
        name=f"{base}/{person}",
        folder=folder,
        frames=torch.arange(frames),
        rate=_RATE,
        joints3d=_landmarks(joints),
        rig=_camera(path, values, frames),
        pixels=_pixels(detections),
        scored=torch.from_numpy(valid > 0),
        videos=present([folder / "imageFiles" / base]),
        others={each: _landmarks(joints) for each, joints in others.items()},
    )


def _people(folder: Path, name: str) -> tuple[str, ...]:
    """Everybody in a sequence, by number."""
    base, _, number = name.partition("/")
    if number:
        return (name,)
    return tuple(f"{base}/{i}" for i in range(_count(*_take(folder, base))))


def _take(folder: Path, base: str) -> tuple[Path, dict[Any, Any]]:
    """The file of a sequence, and what it holds."""
    paths = [path for path in matching(folder, "sequenceFiles/*/*.pkl") if path.stem == base]
    if not paths:
        raise wrong_layout(folder, _TITLE, f"sequenceFiles/*/{base}.pkl", _LAYOUT)
    values = read_pickle(paths[0], _WHAT)
    if not isinstance(values, dict):
        raise InputError(f"{paths[0]}: is {type(values).__name__}, expected the dictionary of 3DPW")
    return paths[0], values


def _landmarks(joints: NDArray[np.float64]) -> torch.Tensor:
    return landmarks_of(joints.reshape(-1, len(SMPL24), 3), SMPL24)


def _person(path: Path, values: dict[Any, Any], number: str) -> tuple[int, int]:
    """How many people there are, and which one is meant."""
    people = _count(path, values)
    if not number and people > 1:
        names = ", ".join(f"{path.stem}/{i}" for i in range(people))
        raise InputError(f"{path}: shows {people} people; name one: {names}")
    number = number or "0"
    if not re.fullmatch(r"[0-9]{1,4}", number) or int(number) >= people:
        raise InputError(f"{path}: has people 0 to {people - 1}, not {number!r:.20}")
    return people, int(number)


def _count(path: Path, values: dict[Any, Any]) -> int:
    people = values.get("jointPositions")
    if not isinstance(people, list) or not 0 < len(people) <= _MAX_PEOPLE:
        raise InputError(f"{path}: has no list jointPositions of people; expected {_WHAT}")
    return len(people)


def _of(
    path: Path, values: dict[Any, Any], key: str, person: int, shape: tuple[int | None, ...]
) -> NDArray[np.float64]:
    """What a list of people holds of one."""
    people = values.get(key)
    if not isinstance(people, list) or len(people) <= person:
        raise InputError(f"{path}: has no list {key} with person {person}; expected {_WHAT}")
    return array_of(f"{path}: {key} of person {person}", people[person], shape, "biuf")


def _pixels(detections: NDArray[np.float64]) -> torch.Tensor:
    """Joints of OpenPose, x, y and confidence of 18, as the landmarks of one view."""
    seen = detections[:, 2:] > 0
    points = np.where(seen, detections[:, :2], np.nan).transpose(0, 2, 1)
    return landmarks_of(points, COCO18)[:, None]


def _camera(path: Path, values: dict[Any, Any], frames: int) -> CameraRig:
    poses = array_of(f"{path}: cam_poses", values.get("cam_poses"), (frames, 4, 4))
    intrinsics = array_of(f"{path}: cam_intrinsics", values.get("cam_intrinsics"), (3, 3))
    if not np.isfinite(intrinsics).all():
        raise InputError(
            f"{path}: cam_intrinsics hold NaN or infinity, expected [[fx, 0, cx], [0, fy, cy], "
            "[0, 0, 1]] in pixels; take the file as it is published"
        )
    # the principal point is the middle of the image, whose size is not given
    size = (round(2 * float(intrinsics[1, 2])), round(2 * float(intrinsics[0, 2])))
    view = make_view(
        f"{path}: camera",
        "phone",
        intrinsics=intrinsics,
        rotation=poses[:, :3, :3],
        translation=poses[:, :3, 3],
        size=size,
    )
    return make_rig(str(path), [view], fps=_RATE)


THREE_DPW = Dataset(
    name="3dpw",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=landmarks_in(SMPL24),
        alignments=(Alignment.ROOT, Alignment.SIMILARITY),
        splits={"train": ("train",), "validation": ("validation",), "test": ("test",)},
        source="von Marcard et al. 2018; papers score 14 joints regressed from SMPL's surface",
    ),
    list_names=list_three_dpw,
    read_sequence=read_three_dpw,
    list_people=_people,
)
