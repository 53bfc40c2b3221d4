"""The two sides of an evaluation: the joints of a result, and the truth of a person."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import unit_of
from perfcap.detect.joint_set import LANDMARKS, canonical_name, doubled_names
from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.io.clip import RATE_SLACK
from perfcap.io.datasets import DatasetSequence, Protocol, find_dataset
from perfcap.io.datasets.layout import MAX_OTHERS, at_frames, matching
from perfcap.io.result_folder import MOTION, PERSON
from perfcap.metrics import Alignment
from perfcap.rates import FASTEST, SLOWEST

_UNKNOWN_FPS = 30.0
_TRUTH_NAMES = ("truth.npz", "gt.npz")
_OWN_LAYOUT = ("gt.npz", "camera.json")  # what tells a folder of the rendered sequences
FILE_PROTOCOL = Protocol(LANDMARKS, tuple(Alignment), {}, "all frames and landmarks")


@dataclass(frozen=True, eq=False)
class FoundJoints:
    """The joints of a result, or of a file of true ones.

    Attributes:
        path: of the file.
        joints: (F, 16, 3), metres, world.
        frames: numbers in the video, (F,).
        fps: frames a second, where the file says so.
    """

    path: Path
    joints: Tensor
    frames: NDArray[np.int64]
    fps: float | None

    @property
    def rate(self) -> float:
        """Frames a second, a common one where the file says nothing."""
        return _UNKNOWN_FPS if self.fps is None else self.fps


@dataclass(frozen=True, eq=False)
class Truth:
    """What a result is compared with.

    Attributes:
        sequence: cameras, joints, silhouettes, surfaces.
        protocol: what of it counts.
        strict: whether every frame of a result needs truth.
        fps: frames a second where its files say so, which results must have too; None where a
            data set is known to have a rate.
    """

    sequence: DatasetSequence
    protocol: Protocol
    strict: bool
    fps: float | None = None

    def scored(self, joints: Tensor) -> Tensor:
        """Landmarks (..., 16, 3), NaN where the protocol does not score them."""
        counted = torch.tensor([name in self.protocol.joints for name in LANDMARKS])
        return torch.where(counted[:, None], joints, torch.nan)


def read_truth(path: Path, dataset: str | None = None, sequence: str | None = None) -> Truth:
    """The truth of a file or folder, or of a sequence of a data set in a folder.

    A folder of a rendered sequence has cameras, silhouettes and surfaces beside the joints.

    Raises:
        InputError: there is none, or it cannot be used.
    """
    if dataset is not None:
        reader = find_dataset(dataset)
        if sequence is None:
            names = reader.sequences(path)
            raise InputError(
                f"--sequence: {path} holds {len(names)} of {reader.title}; name one, such as "
                f"{names[0]!r}"
            )
        return Truth(_measured(reader.read(path, sequence)), reader.protocol, strict=False)
    if sequence is not None:
        raise InputError(f"--sequence {sequence!s:.60}: of which --dataset?")
    if path.is_dir() and all((path / name).is_file() for name in _OWN_LAYOUT):
        reader = find_dataset("rendered")
        whole = path.resolve()  # the name of "." is needed
        rendered = reader.read(whole.parent, whole.name)
        return Truth(_measured(rendered), reader.protocol, strict=True, fps=rendered.rate)
    true = read_found(find_truth(path))
    return Truth(_of_file(true), FILE_PROTOCOL, strict=True, fps=true.fps)


def read_found(path: Path) -> FoundJoints:
    """The joints of a ``motion.npz``, or of any file with such arrays.

    Raises:
        InputError: it is missing or holds something else.
    """
    values = _load(path)
    joints = torch.tensor(values["joints3d"].astype(float))
    fps = float(values["fps"].reshape(())) if "fps" in values else None
    return FoundJoints(path, joints, values["frames"].astype(np.int64), fps)


def require_rate(found: FoundJoints, fps: float | None, where: Path) -> None:
    """Refuse a truth of another frame rate: frames are matched by number.

    Raises:
        InputError: both rates are known and differ.
    """
    if found.fps is None or fps is None or abs(found.fps / fps - 1) <= RATE_SLACK:
        return
    raise InputError(
        f"{where}: runs at {fps:.4g} frames a second, {found.path} at {found.fps:.4g}; expected "
        "the truth of every frame of the result, resample it"
    )


def find_truth(path: Path) -> Path:
    """The truth file of a folder, or the file itself.

    Raises:
        InputError: there is none.
    """
    if path.is_file():
        return path
    for name in _TRUTH_NAMES:
        if (path / name).is_file():
            return path / name
    if (path / MOTION).is_file():
        raise InputError(
            f"--truth {path}: is the folder of a capture, no truth; to compare two captures give "
            f"{path / MOTION}, or type perfcap view FIRST SECOND"
        )
    if path.is_dir():
        people = sorted(each for name in _TRUTH_NAMES for each in path.glob(f"*/{name}"))
        where = f"; of one person give {people[0].parent}, or another" if people else ""
        raise InputError(f"--truth {path}: holds no {' and no '.join(_TRUTH_NAMES)}{where}")
    raise InputError(f"--truth {path}: no such file; expected an npz or a folder with truth.npz")


def match_frames(found: NDArray[np.int64], truth: Truth, where: str) -> tuple[list[int], list[int]]:
    """Rows of a result and rows of the truth that show the same frames, in the result's order.

    Raises:
        InputError: there are none, or the truth is strict and lacks some.
    """
    counted = truth.sequence.counted(truth.protocol).tolist()
    numbers = enumerate(truth.sequence.frames.tolist())
    index = {frame: row for row, frame in numbers if counted[row]}
    rows = [index.get(int(frame), -1) for frame in found]
    lacking = rows.count(-1)
    if (truth.strict and lacking) or lacking == len(rows):
        raise InputError(
            f"{truth.sequence.folder}: lacks {lacking} of the {len(rows)} frames of {where}; "
            f"expected {'all' if truth.strict else 'some'} of them"
        )
    kept = [row for row, other in enumerate(rows) if other >= 0]
    return kept, [rows[row] for row in kept]


def rate_doubts(found: FoundJoints, truth: Truth) -> list[str]:
    """What speaks against a result's frames being those of a data set: another rate."""
    sequence, fps = truth.sequence, found.fps
    if truth.fps is not None or fps is None or not sequence.rate_known:
        return []
    if abs(fps / sequence.rate - 1) <= RATE_SLACK:
        return []
    return [
        f"{sequence.folder}: {sequence.name} runs at {sequence.rate:.4g} frames a second, "
        f"{found.path} at {fps:.4g}, and frames are matched by number: expected a capture of the "
        "data set's own video, of every frame"
    ]


def _measured(sequence: DatasetSequence) -> DatasetSequence:
    """A sequence whose landmarks at 0, 0, 0 are unknown: nobody has one in the world's origin.

    None is an origin either, as in files of one's own: sets that have one take the middle hip.
    """
    if sequence.joints3d is None:
        return sequence
    empty = (sequence.joints3d == 0).all(-1)
    frames = sequence.frames[empty.any(1)]
    if not len(frames):
        return sequence
    names = [name for name, some in zip(LANDMARKS, empty.any(0).tolist(), strict=True) if some]
    warning = (
        f"{sequence.folder}: {sequence.name} has {', '.join(names)} at 0, 0, 0 in {len(frames)} of "
        f"{len(empty)} frames (first {int(frames[0])}), as if not measured; they are left out"
    )
    joints = torch.where(empty[..., None], torch.nan, sequence.joints3d)
    return replace(sequence, joints3d=joints, warnings=(*sequence.warnings, warning))


def _of_file(true: FoundJoints) -> DatasetSequence:
    return DatasetSequence(
        dataset="file",
        name=true.path.stem,
        folder=true.path,
        frames=torch.from_numpy(true.frames),
        rate=true.rate,
        joints3d=true.joints,
        others=_beside(true),
    )


def _beside(true: FoundJoints) -> dict[str, torch.Tensor]:
    """Joints (F, 16, 3) of other people in folders beside that of a file, by what to give."""
    place = true.path.parent
    place = place if PERSON.fullmatch(place.name) else place.resolve()  # the name of "." is needed
    found: dict[str, torch.Tensor] = {}
    if not PERSON.fullmatch(place.name):
        return found
    for folder in matching(place.parent, "person*"):
        if folder.name == place.name or not PERSON.fullmatch(folder.name):
            continue
        for name in dict.fromkeys((true.path.name, *_TRUTH_NAMES)):
            if len(found) == MAX_OTHERS or not (folder / name).is_file():
                continue
            with suppress(InputError):  # a damaged file of another person is no fault of this one
                other = read_found(folder / name)
                key = str(folder if name in _TRUTH_NAMES else folder / name)
                found[key] = at_frames(other.joints, other.frames.tolist(), true.frames.tolist())
            break
    return found


def _load(path: Path) -> dict[str, NDArray[Any]]:
    names = ("joints3d", "frames", "fps", "joint_names")
    if path.suffix.lower() in (".trc", ".c3d", ".csv", ".bvh"):
        raise InputError(
            f"{path}: is a file of another program; expected an npz with joints3d "
            "[F,16,3] in metres, or the folder of a data set: --dataset pose2sim reads a project "
            "with its .trc"
        )
    values = read_archive(path, names, "an npz with joints3d")
    joints = values.get("joints3d")
    if joints is None or joints.ndim != 3 or joints.shape[1:] != (16, 3) or not len(joints):
        found = "missing" if joints is None else f"of shape {joints.shape}"
        raise InputError(f"{path}: joints3d is {found}, expected (F, 16, 3) in metres")
    frames, fps = values.setdefault("frames", np.arange(len(joints))), values.get("fps")
    if frames.shape != joints.shape[:1] or frames.dtype.kind not in "iu":
        raise InputError(
            f"{path}: frames is {frames.dtype} {frames.shape}, expected {len(joints)} frame numbers"
        )
    numbers, counts = np.unique(frames, return_counts=True)
    if counts.max() > 1:
        raise InputError(
            f"{path}: frames names {numbers[counts.argmax()]} {counts.max()} times; expected a "
            "number of its own for each frame"
        )
    if fps is not None and (
        fps.size != 1 or fps.dtype.kind not in "fiu" or not SLOWEST <= fps < FASTEST
    ):
        raise InputError(f"{path}: fps is {fps}, expected a positive number")
    if joints.dtype.kind not in "fiu" or not np.isfinite(joints).all():
        raise InputError(f"{path}: joints3d holds {joints.dtype} that are not all finite numbers")
    named = values.get("joint_names")
    if named is not None:
        joints = values["joints3d"] = joints[:, _order(path, named)]
    unit = unit_of(float(np.median(np.ptp(joints, axis=1).max(-1))))
    if unit != "metres":
        raise InputError(f"{path}: joints3d look like {unit}, expected metres; convert them")
    at_zero = (joints == 0).all(-1)  # one joint may be the origin of all frames
    empty = np.flatnonzero((at_zero.sum(1) > 1) | at_zero[:, ~at_zero.all(0)].any(1))
    if len(empty):  # a frame of one place fits whatever it is compared with
        raise InputError(
            f"{path}: joints3d has joints at 0, 0, 0 in {len(empty)} of {len(joints)} frames "
            f"(first {frames[empty[0]]}), as if not measured; expected places in all: fill "
            "gaps from the frames beside, or capture a part without (--frames)"
        )
    return values


def _order(path: Path, named: NDArray[Any]) -> list[int]:
    """Where each landmark is among joints with these names."""
    given = [str(name) for name in named.reshape(-1)]
    names, twice = [canonical_name(name) for name in given], doubled_names(given)
    lacking = [name for name in LANDMARKS if name not in names]
    if lacking or len(names) != len(LANDMARKS):
        raise InputError(
            f"{path}: joint_names are {len(names)} names without {', '.join(lacking) or 'any more'}"
            + (f", {twice:.80} being the same joint" if twice else "")
            + f"; expected the {len(LANDMARKS)} landmarks, in any order: {', '.join(LANDMARKS)}"
        )
    return [names.index(name) for name in LANDMARKS]
