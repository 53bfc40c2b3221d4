"""CMU Panoptic Studio (Joo et al. 2015): people in a dome of cameras.

``SEQUENCE/calibration_SEQUENCE.json`` and ``SEQUENCE/hdPose3d_stage1_coco19/body3DScene_*.json``,
centimetres. Of several people one is named by id: ``SEQUENCE/0``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.view import View, make_view, to_numbers
from perfcap.io.datasets.joint_sets import COCO19, landmarks_in
from perfcap.io.datasets.layout import (
    MAX_FRAMES,
    MAX_OTHERS,
    check_name,
    landmarks_of,
    matching,
    present,
    wrong_layout,
)
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol
from perfcap.io.files import MEBIBYTE, read_json
from perfcap.metrics import Alignment

_TITLE = "CMU Panoptic"
_LAYOUT = "NAME/calibration_NAME.json and NAME/hdPose3d_stage1_coco19/body3DScene_*.json"
_POSES = "hdPose3d_stage1_coco19"
_WHAT = "a frame of CMU Panoptic"
_RATE = 29.97
_CENTIMETRE = 1e-2
_LIMIT = 16 * MEBIBYTE
_MAX_PEOPLE = 99  # each is read on its own
_NAME = re.compile(r"[\w-]{1,40}")
_ID = re.compile(r"-?[0-9]{1,18}")
_FRAME = re.compile(r"body3DScene_(\d{1,9})\.json")


def list_panoptic(folder: Path) -> tuple[str, ...]:
    """Names of the sequences, without the id of a person that may follow."""
    found = [path.parent.name for path in matching(folder, f"*/{_POSES}")]
    if not found:
        raise wrong_layout(folder, _TITLE, f"NAME/{_POSES}", _LAYOUT)
    return tuple(found)


def read_panoptic(folder: Path, name: str) -> DatasetSequence:
    """The only person of a sequence, or one of several by id."""
    base, _, person = name.partition("/")
    place, bodies = _take(folder, base)
    people = {identity for frame in bodies.values() for identity in frame}
    chosen = _choose(place, person, people)
    nothing = np.full((len(COCO19), 3), np.nan)

    def landmarks(identity: int) -> Tensor:
        points = np.stack([frame.get(identity, nothing) for frame in bodies.values()])
        return landmarks_of(points, COCO19, _CENTIMETRE)

    rig = _cameras(place / f"calibration_{base}.json")
    return DatasetSequence(
        dataset="panoptic",
        name=name,
        folder=place,
        frames=torch.tensor(list(bodies)),
        rate=_RATE,
        joints3d=landmarks(chosen),
        rig=rig,
        videos=present([place / "hdVideos" / f"hd_{view}.mp4" for view in rig.names]),
        others={f"{base}/{i}": landmarks(i) for i in sorted(people - {chosen})[:MAX_OTHERS]},
    )


def _people(folder: Path, name: str) -> tuple[str, ...]:
    """Everybody whom a frame of a sequence shows, by id."""
    base, _, person = name.partition("/")
    if person:
        return (name,)
    place, bodies = _take(folder, base)
    people = sorted({identity for frame in bodies.values() for identity in frame})
    if len(people) > _MAX_PEOPLE:
        raise InputError(
            f"{place / _POSES}: shows {len(people)} people, expected {_MAX_PEOPLE} at most; name "
            f"one, such as {base}/{people[0]}"
        )
    return tuple(f"{base}/{i}" for i in people) or (name,)


def _take(folder: Path, base: str) -> tuple[Path, dict[int, dict[int, NDArray[np.float64]]]]:
    """The folder of a sequence; of each frame, joints (19, 3) of everybody, cm."""
    check_name(folder, _TITLE, base, list_panoptic(folder))
    place = folder / base
    files = {
        int(match[1]): path
        for path in matching(place / _POSES, "body3DScene_*.json")
        if (match := _FRAME.fullmatch(path.name))
    }
    if not 0 < len(files) <= MAX_FRAMES:
        raise wrong_layout(place, _TITLE, f"{_POSES}/body3DScene_*.json", _LAYOUT)
    return place, {frame: _bodies(path) for frame, path in sorted(files.items())}


def _bodies(path: Path) -> dict[int, NDArray[np.float64]]:
    """Joints (19, 3) by id of the person, centimetres; NaN without confidence."""
    values = read_json(path, _WHAT, _LIMIT)
    bodies = values.get("bodies") if isinstance(values, dict) else None
    if not isinstance(bodies, list):
        raise InputError(f"{path}: has no list bodies; expected {_WHAT}")
    found = {}
    for body in bodies:
        numbers = body.get("joints19") if isinstance(body, dict) else None
        identity = body.get("id") if isinstance(body, dict) else None
        if not isinstance(identity, int) or numbers is None:
            raise InputError(f"{path}: a body lacks id or joints19; expected {_WHAT}")
        if identity in found:
            raise InputError(
                f"{path}: has two bodies of id {identity!s:.20}, expected each person once; remove "
                "one of them"
            )
        joints = to_numbers(str(path), "joints19", numbers)
        if joints.shape != (4 * len(COCO19),):
            raise InputError(f"{path}: joints19 has shape {joints.shape}, expected 19 x 4 numbers")
        rows = joints.reshape(-1, 4)
        found[identity] = np.where(rows[:, 3:] > 0, rows[:, :3], np.nan)
    return found


def _choose(place: Path, person: str, identities: set[int]) -> int:
    names = ", ".join(f"{place.name}/{i}" for i in sorted(identities)[:12])
    if not identities:
        raise InputError(f"{place / _POSES}: shows nobody in any frame")
    if not person and len(identities) == 1:
        return next(iter(identities))
    if not _ID.fullmatch(person) or int(person) not in identities:
        raise InputError(f"{place / _POSES}: shows {len(identities)} people; name one: {names}")
    return int(person)


def _cameras(path: Path) -> CameraRig:
    """The HD cameras."""
    values = read_json(path, "a calibration of CMU Panoptic", _LIMIT)
    cameras = values.get("cameras") if isinstance(values, dict) else None
    if not isinstance(cameras, list):
        raise InputError(f"{path}: has no list cameras; expected a calibration of CMU Panoptic")
    chosen = [c for c in cameras if isinstance(c, dict) and c.get("type") == "hd"]
    if not chosen:
        raise InputError(f"{path}: has no camera of type hd among {len(cameras)}")
    return make_rig(str(path), [_view(path, camera) for camera in chosen], fps=_RATE)


def _view(path: Path, camera: dict[str, Any]) -> View:
    name = camera.get("name")
    where = f"{path}: camera {name!s:.20}"
    if not isinstance(name, str) or not _NAME.fullmatch(name):  # of a file beside it
        raise InputError(f"{where}: has no name of letters, digits and dashes, such as 00_12")
    size = camera.get("resolution")
    if not isinstance(size, list) or len(size) != 2:
        raise InputError(f"{where}: resolution is {size!r:.40}, expected [width, height]")
    translation = to_numbers(where, "t", camera.get("t", np.nan)).reshape(-1)
    return make_view(
        where,
        name,
        intrinsics=camera.get("K"),
        rotation=camera.get("R"),
        translation=_CENTIMETRE * translation,
        distortion=camera.get("distCoef"),
        size=(size[1], size[0]),
    )


PANOPTIC = Dataset(
    name="panoptic",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=landmarks_in(COCO19),
        alignments=(Alignment.ABSOLUTE, Alignment.ROOT, Alignment.SIMILARITY),
        splits={},
        source="Joo et al. 2015; views and sequences differ from paper to paper",
    ),
    list_names=list_panoptic,
    read_sequence=read_panoptic,
    list_people=_people,
)
