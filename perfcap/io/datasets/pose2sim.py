"""Recordings of Pose2Sim: calibrated views, triangulated joints as truth.

A recording's folder holds ``calibration/*.toml``, and ``pose3d/`` or ``pose-3d/`` with ``*.trc``,
as Pose2Sim writes them, or with ``reference3d*.npz`` (``joints3d_m``, ``names``), a triangulation
in the axes of the calibration, which is preferred. A folder with several of these, one a person,
is read as ``NAME/REFERENCE``. What Pose2Sim filters or augments is the same person once more.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import (
    KNOWN_JOINTS,
    LANDMARKS,
    JointSet,
    canonical_name,
    doubled_names,
)
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.calibration import read_cameras
from perfcap.io.datasets.layout import (
    MAX_OTHERS,
    array_of,
    at_frames,
    check_name,
    landmarks_of,
    matching,
    named_below,
    wrong_layout,
)
from perfcap.io.datasets.sequence import Dataset, DatasetSequence, Protocol
from perfcap.io.datasets.trc import Markers, read_trc
from perfcap.metrics import Alignment

_TITLE = "a Pose2Sim recording"
_LAYOUT = "NAME/calibration/Calib*.toml with NAME/pose3d/ or NAME/pose-3d/ of *.trc"
_WHAT = "a triangulation: joints3d_m (F, J, 3) in metres and names (J)"
# a triangulation is better where views were registered to the scene
_PREFERRED_CALIBRATION = "Calib_scene.toml"
_DEFAULT_RATE = 60.0
_PROCESSED = re.compile(r"(_filt_\w+|_LSTM)+$")  # what Pose2Sim adds to the names of its files


def list_pose2sim(folder: Path) -> tuple[str, ...]:
    """Names of the recordings, people as ``NAME/REFERENCE`` where there are several."""
    names = []
    for calibration in matching(folder, "*/calibration"):
        references = _references(calibration.parent)
        name = calibration.parent.name
        names += [name] if len(references) == 1 else [f"{name}/{r.stem}" for r in references]
    if not names:
        raise wrong_layout(folder, _TITLE, "NAME/calibration and NAME/pose3d", _LAYOUT)
    return tuple(names)


def read_pose2sim(folder: Path, name: str) -> DatasetSequence:
    """One person of a recording."""
    check_name(folder, _TITLE, name, list_pose2sim(folder))
    base, _, person = name.partition("/")
    recording = folder / base
    references = {path.stem: path for path in _references(recording)}
    reference = references[person] if person else next(iter(references.values()))
    joints3d, markers = _landmarks(reference)
    frames, rate = markers.frames, markers.rate
    return DatasetSequence(
        dataset="pose2sim",
        name=name,
        folder=recording,
        frames=torch.from_numpy(frames),
        rate=rate or _DEFAULT_RATE,
        rate_known=rate is not None,
        joints3d=joints3d,
        rig=read_cameras(_calibration(recording)),
        videos=tuple(matching(recording, "videos/*.mp4")),
        warnings=(
            "the truth is a triangulation of detected joints, good to some centimetres",
            *_doubts(reference, frames),
            *markers.warnings,
        ),
        others=_others(base, reference, references.values(), frames.tolist()),
    )


def _people(folder: Path, name: str) -> tuple[str, ...]:
    """Everybody in a recording, of each the first file."""
    people: dict[str, str] = {}
    for each in named_below(name, list_pose2sim(folder)):
        people.setdefault(_PROCESSED.sub("", each), each)
    return tuple(people.values())


def _others(
    base: str, own: Path, references: Iterable[Path], frames: Sequence[int]
) -> dict[str, Tensor]:
    """Landmarks (F, 16, 3) of the other people of a recording, by name."""
    found: dict[str, Tensor] = {}
    seen = {_PROCESSED.sub("", own.stem)}
    for path in references:
        person = _PROCESSED.sub("", path.stem)
        if person in seen or len(found) == MAX_OTHERS:
            continue
        seen.add(person)
        with suppress(InputError):  # a damaged file of another person is no fault of this one
            joints, markers = _landmarks(path)
            if len(joints):
                numbers = markers.frames.tolist()
                found[f"{base}/{path.stem}"] = at_frames(joints, numbers, frames)
    return found


def _landmarks(path: Path) -> tuple[Tensor, Markers]:
    """Landmarks (F, 16, 3), and what they are of."""
    markers = _joints(path)
    names = markers.names
    called = [canonical_name(name) for name in names]
    if not set(called) & set(LANDMARKS):
        raise InputError(f"{path}: names {', '.join(names[:5])}, none of the landmarks")
    twice = doubled_names([name for name in names if canonical_name(name) in KNOWN_JOINTS])
    if twice:
        raise InputError(
            f"{path}: names {twice:.200}, the same joint; expected each joint once: rename or "
            "remove what is not it"
        )
    # markers that perfcap has no use for may be called anything
    read = [name if name in KNOWN_JOINTS else f"unread_{i}" for i, name in enumerate(called)]
    joint_set = JointSet(path.stem, tuple(read))
    return landmarks_of(markers.points, joint_set), markers


def _joints(path: Path) -> Markers:
    """Joints in the axes of the calibration; frames are those of the video."""
    if path.suffix == ".npz":
        values = read_archive(path, ("joints3d_m", "names"), _WHAT)
        points = array_of(f"{path}: joints3d_m", values.get("joints3d_m"), (None, None, 3))
        names = tuple(str(name) for name in values.get("names", np.zeros(0)).reshape(-1))
        if len(names) != points.shape[1] or not len(points):
            raise InputError(
                f"{path}: has {len(names)} names for joints3d_m {points.shape}; expected {_WHAT}, "
                "of one frame or more"
            )
        beside = matching(path.parent, "*.trc")
        rate = read_trc(beside[0]).rate if beside else None
        return Markers(names, points, np.arange(len(points)), rate)
    markers = read_trc(path)
    # files are Y up, calibrations Z up: Pose2Sim turns the axes round when it writes
    # rows of whole videos are counted from 0 or 1, of parts from 1, as perfcap does
    frames = markers.frames - min(int(markers.frames[0]), 1)
    return replace(markers, points=markers.points[..., [2, 0, 1]], frames=frames)


def _doubts(reference: Path, frames: NDArray[np.int64]) -> Iterator[str]:
    """That rows of a file are not those of the whole video."""
    if frames[0] > 0:
        yield (
            f"{reference.name}: its frames are numbered from {frames[0] + 1}, which is taken for "
            f"frame {frames[0]} of the video; errors are too large where the file counts from 0"
        )
    elif reference.suffix == ".trc" and (part := re.search(r"_([1-9]\d*)-\d+\D*$", reference.stem)):
        yield (
            f"{reference.name}: its name says that it begins with frame {part[1]}, its rows are "
            "counted from the start of the video; where they are not, number them so"
        )


def _references(recording: Path) -> list[Path]:
    for pattern in ("reference3d*.npz", "*.trc"):
        found = [p for place in ("pose3d", "pose-3d") for p in matching(recording / place, pattern)]
        if found:
            return found
    return []


def _calibration(recording: Path) -> Path:
    preferred = recording / "calibration" / _PREFERRED_CALIBRATION
    found = [preferred] if preferred.is_file() else matching(recording, "calibration/*.toml")
    if not found:
        raise wrong_layout(recording, _TITLE, "calibration/*.toml", _LAYOUT)
    return found[0]


POSE2SIM = Dataset(
    name="pose2sim",
    title=_TITLE,
    layout=_LAYOUT,
    protocol=Protocol(
        joints=LANDMARKS,
        alignments=(Alignment.ABSOLUTE, Alignment.ROOT, Alignment.SIMILARITY),
        splits={},
        source="Pagnon et al. 2022; no protocol is published with the recordings",
    ),
    list_names=list_pose2sim,
    read_sequence=read_pose2sim,
    list_people=_people,
)
