"""Recorded motion as landmark trajectories: what lifters and renderers learn poses from."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError
from perfcap.io.archive import read_archive
from perfcap.train.library_bones import require_ends, require_moving
from perfcap.train.library_checks import (
    order_doubts,
    read_index,
    require_degrees,
    require_motion,
    require_own_motion,
    require_shapes,
    require_sides,
    require_skeleton,
    shared_bodies,
    usually_upright,
)
from perfcap.train.library_takes import size_doubts, take_doubts
from perfcap.train.library_trials import leap_doubts, reading_fault, require_readings, sliding

RATE = 60.0  # Hz
_WHAT = "the arrays of a packed motion library"

Array = NDArray[np.float64]

# the landmarks among the joints of the CMU skeleton; the crown lies 16 cm above the head's joint
_SOURCE = (
    "Head", "Neck", "RightArm", "RightForeArm", "RightHand", "LeftArm", "LeftForeArm", "LeftHand",
    "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase",
    "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase",
)  # fmt: skip
_CROWN = np.array([0.0, 0.16, 0.0])

# the source of each joint of the skeleton, in the order of ``JOINTS``
_TURNED = {
    "pelvis": "Hips", "spine": "Spine1", "neck": "Neck", "head": "Head",
    "l_shoulder": "LeftArm", "r_shoulder": "RightArm",
    "l_elbow": "LeftForeArm", "r_elbow": "RightForeArm",
    "l_wrist": "LeftHand", "r_wrist": "RightHand",
    "l_hip": "LeftUpLeg", "r_hip": "RightUpLeg",
    "l_knee": "LeftLeg", "r_knee": "RightLeg",
    "l_ankle": "LeftFoot", "r_ankle": "RightFoot",
}  # fmt: skip
STRAIGHT = {
    **{f"l_{joint}": (1.0, 0.0, 0.0) for joint in ("shoulder", "elbow", "wrist")},
    **{f"r_{joint}": (-1.0, 0.0, 0.0) for joint in ("shoulder", "elbow", "wrist")},
    **{f"{side}_{joint}": (0.0, -1.0, 0.0) for side in "lr" for joint in ("hip", "knee")},
    **{f"{side}_ankle": (0.0, 0.0, 1.0) for side in "lr"},
}
"""Directions of the bones of a T-pose, by the joint they start at; hands go on as forearms do."""
_BONE_ENDS = {
    "LeftArm": "LeftForeArm", "LeftForeArm": "LeftHand", "LeftHand": "LeftHand",
    "RightArm": "RightForeArm", "RightForeArm": "RightHand", "RightHand": "RightHand",
    "LeftUpLeg": "LeftLeg", "LeftLeg": "LeftFoot", "LeftFoot": "LeftToeBase",
    "RightUpLeg": "RightLeg", "RightLeg": "RightFoot", "RightFoot": "RightToeBase",
}  # fmt: skip


@dataclass(frozen=True)
class Recording:
    """One clip, at 60 Hz.

    Attributes:
        name: of the clip.
        subject: who moves.
        landmarks: (F, 16, 3) in the world, metres, y up.
        turns: how each joint of the skeleton is turned in the world against a T-pose that faces
            +z, arms along x, legs down, feet ahead, (F, 16, 3, 3), in the order of ``JOINTS``.
        doubt: what speaks against its angles by themselves; None if nothing does.
    """

    name: str
    subject: str
    landmarks: Tensor
    turns: Tensor
    doubt: str | None = None


@dataclass(frozen=True)
class MotionLibrary:
    """Clips of several people."""

    recordings: tuple[Recording, ...]

    @property
    def digest(self) -> str:
        """SHA-256 of names, people and poses, in hexadecimal: another one is other data."""
        total = hashlib.sha256()
        for recording in self.recordings:
            total.update(f"{recording.name}\0{recording.subject}\0".encode())
            for poses in (recording.landmarks, recording.turns):
                total.update(poses.contiguous().numpy().tobytes())
        return total.hexdigest()

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a folder with ``clips.npz`` and ``clips.csv``; clips marked as glitches are left.

        Raises:
            InputError: it lacks a file, a clip or a joint, holds NaN, or is in other units, axes
                or rates.
        """
        index, archive = folder / "clips.csv", folder / "clips.npz"
        for path in (index, archive):
            if not path.is_file():
                raise InputError(f"{path}: no such file; expected a packed motion library")
        rows = read_index(index)
        skeleton = read_archive(archive, ("joint_names", "parents"), _WHAT)
        names = require_skeleton(archive, skeleton, tuple({*_SOURCE, *_TURNED.values()}))
        clips = {row["clip"]: _clip(archive, row, len(names)) for row in rows}
        angles = {name: clip["euler_zyx_deg"] for name, clip in clips.items()}
        require_degrees(archive, angles)
        recordings = tuple(
            Recording(
                row["clip"],
                row["subject"],
                *_poses(archive, row["clip"], clips[row["clip"]], names, skeleton["parents"]),
            )
            for row in rows
        )
        motion = {recording.name: recording.landmarks for recording in recordings}
        root = {name: torch.from_numpy(clip["root_m"]) for name, clip in clips.items()}
        require_motion(archive, motion, root)
        require_ends(archive, motion)
        parents = skeleton["parents"].tolist()

        def pose(angles: Array, places: Array, offsets: Array) -> Array:
            return _landmarks(angles, places, offsets, names, skeleton["parents"])[0]

        for whose, some in _people(archive, rows):
            require_moving(whose, [angles[name] for name in some], names)
            require_sides(whose, [motion[name] for name in some])
            own = {name: clips[name] for name in some}
            require_readings(whose, own, names, parents, pose)
        inner = {name: values[:, 1:] for name, values in angles.items()}
        require_own_motion(archive, inner, {row["clip"]: row["subject"] for row in rows})
        return cls(
            tuple(
                replace(each, doubt=reading_fault([clips[each.name]], names, parents, pose))
                for each in recordings
            )
        )

    @property
    def subjects(self) -> tuple[str, ...]:
        """People, sorted."""
        return tuple(sorted({recording.subject for recording in self.recordings}))

    def of(self, subjects: Sequence[str]) -> MotionLibrary:
        """The clips of some people.

        Raises:
            InputError: one of them has none.
        """
        if not subjects:
            raise InputError(f"subjects: none; expected some of {', '.join(self.subjects)}")
        self._require(subjects)
        return self._where(lambda recording: recording.subject in subjects)

    def without(self, subjects: Sequence[str]) -> MotionLibrary:
        """The clips of everybody else.

        Raises:
            InputError: one of them has none, by whose wrong name people would not be held out; or
                one is named twice, as held out and for validation, which chooses the weights.
        """
        self._require(subjects)
        twice = sorted({name for name in subjects if list(subjects).count(name) > 1})
        if twice:
            raise InputError(
                f"subjects: {', '.join(twice)} are named twice; people that are held out must not "
                "be those of the validation, which chooses the weights"
            )
        return self._where(lambda recording: recording.subject not in subjects)

    def doubts(self, kept: Sequence[str]) -> Iterator[str]:
        """What speaks against the motion, and against people who are kept from training being
        others than the rest.
        """
        takes: dict[str, list[Recording]] = {}
        for recording in self.recordings:
            takes.setdefault(recording.subject, []).append(recording)
        clips = {subject: [each.landmarks for each in own] for subject, own in takes.items()}
        told = [*sliding(recording.landmarks.numpy() for recording in self.recordings)]
        for subject, own in clips.items() if not told else ():
            lines = (*sliding(each.numpy() for each in own), *size_doubts(own))
            told += [f"subject {subject}: {line}" for line in lines]
            if not usually_upright(own):
                told.append(
                    f"subject {subject} lies or stands on their head in most frames; if they do "
                    "not, root_m and euler_zyx_deg of the root are not y up, in degrees"
                )
        for subject, own in clips.items():
            names = [take.name for take in takes[subject]]
            lines = (
                *take_doubts(names, own, [take.doubt for take in takes[subject]]),
                *order_doubts(names, own),
                *leap_doubts(each.numpy() for each in own),
            )
            told += [f"subject {subject}: {line}" for line in lines]
        yield from told
        same = shared_bodies(clips, kept)
        if same:
            pairs = ", ".join(f"{one} and {other}" for one, other in same[:3])
            more = ", ..." if len(same) > 3 else ""
            yield (
                f"the subjects {pairs}{more} have the same bones, and the first of each is kept "
                "from training: if they are one person, give their clips one subject, or errors on "
                "people held out are too small"
            )

    def _require(self, subjects: Sequence[str]) -> None:
        unknown = sorted(set(subjects) - set(self.subjects))
        if unknown:
            raise InputError(
                f"subjects: {', '.join(unknown)} have no clips; expected some of "
                f"{', '.join(self.subjects)}"
            )

    def _where(self, wanted: Callable[[Recording], bool]) -> MotionLibrary:
        return MotionLibrary(tuple(r for r in self.recordings if wanted(r)))


def _people(
    path: Path, rows: Sequence[Mapping[str, str]]
) -> Iterator[tuple[Path | str, list[str]]]:
    """All people together, and each: a library may be put together of several sources."""
    clips: dict[str, list[str]] = {}
    for row in rows:
        clips.setdefault(row["subject"], []).append(row["clip"])
    yield path, [row["clip"] for row in rows]
    if len(clips) > 1:
        for subject, some in clips.items():
            yield f"{path}: subject {subject}", some


def _clip(path: Path, row: Mapping[str, str], joints: int) -> dict[str, Array]:
    """Angles, root and offsets of a clip of the index."""
    parts = {f"{row['clip']}/{part}": part for part in ("euler_zyx_deg", "root_m", "offsets_m")}
    found = read_archive(path, tuple(parts), _WHAT)
    if len(found) < len(parts):
        raise InputError(f"{path}: lacks clip {row['clip']}, which the index names")
    clip = {parts[name]: values.astype(np.float64) for name, values in found.items()}
    require_shapes(path, row, clip, joints)
    return clip


def _poses(
    path: Path, clip: str, data: Mapping[str, Array], names: list[str], parents: NDArray[np.int64]
) -> tuple[Tensor, Tensor]:
    euler, root, offsets = data["euler_zyx_deg"], data["root_m"], data["offsets_m"]
    points, rotation = _landmarks(euler, root, offsets, names, parents)
    if not np.isfinite(points).all():
        raise InputError(f"{path}: clip {clip} is not finite; remove it from the index")
    turns = rotation[:, [names.index(theirs) for theirs in _TURNED.values()]]
    turns = turns @ _from_straight(names, offsets)
    return torch.from_numpy(points.astype(np.float32)), torch.from_numpy(turns.astype(np.float32))


def _landmarks(
    euler: Array, root: Array, offsets: Array, names: list[str], parents: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Landmarks (F, 16, 3) of angles in degrees, and rotations of joints (F, J, 3, 3)."""
    columns = [names.index(name) for name in _SOURCE]
    places, rotation = _kinematics(np.radians(euler), root, offsets, parents)
    points = places[:, columns]
    points[:, 0] += rotation[:, columns[0]] @ _CROWN
    return points, rotation


def _from_straight(names: list[str], offsets: Array) -> Array:
    """Turns (16, 3, 3) that take the straight bones of a T-pose to the rest pose of a file."""
    turns = np.tile(np.eye(3), (len(_TURNED), 1, 1))
    for row, (ours, theirs) in enumerate(_TURNED.items()):
        if ours in STRAIGHT:
            straight = np.array(STRAIGHT[ours])
            turns[row] = smallest_turn(straight, offsets[names.index(_BONE_ENDS[theirs])])
    return turns


def smallest_turn(start: Array, end: Array) -> Array:
    """The rotation (3, 3) about their common normal that takes one direction (3,) to another.

    Opposite directions have no smallest turn; the identity is returned for them, and for zeros.
    """
    a, b = (v / max(float(np.linalg.norm(v)), 1e-12) for v in (start, end))
    normal, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1 + 1e-9:
        return np.eye(3)
    x, y, z = normal
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: Array = np.eye(3) + cross + cross @ cross / (1 + cosine)
    return turn


def _kinematics(
    euler: Array, root: Array, offsets: Array, parents: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Positions (F, J, 3) and rotations (F, J, 3, 3) of joints from intrinsic z, y, x angles."""
    rotation = _rotations(euler)
    places = np.zeros((*euler.shape[:2], 3))
    for joint, parent in enumerate(parents):
        if parent < 0:
            places[:, joint] = root
            continue
        rotation[:, joint] = rotation[:, parent] @ rotation[:, joint]
        places[:, joint] = places[:, parent] + rotation[:, parent] @ offsets[joint]
    return places, rotation


def _rotations(euler: Array) -> Array:
    """Rz(a) Ry(b) Rx(c) of angles (..., 3)."""
    (cz, cy, cx), (sz, sy, sx) = (np.moveaxis(f(euler), -1, 0) for f in (np.cos, np.sin))
    rows = (
        cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx,
        sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx,
        -sy, cy * sx, cy * cx,
    )  # fmt: skip
    stacked: Array = np.stack(rows, -1).reshape(*euler.shape[:-1], 3, 3)
    return stacked
