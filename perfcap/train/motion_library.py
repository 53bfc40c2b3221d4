"""Recorded motion as landmark trajectories: what lifters and renderers learn poses from."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError

RATE = 60.0  # Hz

Array = NDArray[np.float64]

# the landmarks among the joints of the CMU skeleton; the crown lies 16 cm above the head's joint
_SOURCE = (
    "Head", "Neck", "RightArm", "RightForeArm", "RightHand", "LeftArm", "LeftForeArm", "LeftHand",
    "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase",
    "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase",
)  # fmt: skip
_CROWN = np.array([0.0, 0.16, 0.0])


@dataclass(frozen=True)
class Recording:
    """One clip: landmarks (F, 16, 3) in the world, metres, y up, at 60 Hz."""

    name: str
    subject: str
    landmarks: Tensor


@dataclass(frozen=True)
class MotionLibrary:
    """Clips of several people."""

    recordings: tuple[Recording, ...]

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a folder with ``clips.npz`` and ``clips.csv``; clips marked as glitches are left.

        Raises:
            InputError: it lacks a file or a clip, or holds NaN.
        """
        index, archive = folder / "clips.csv", folder / "clips.npz"
        for path in (index, archive):
            if not path.is_file():
                raise InputError(f"{path}: no such file; expected a packed motion library")
        with index.open(encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if "glitch" not in (row["remark"] or "")]
        with np.load(archive, allow_pickle=False) as data:
            names = [str(name) for name in data["joint_names"]]
            columns = [names.index(name) for name in _SOURCE]
            recordings = [
                Recording(
                    row["clip"], row["subject"], _landmarks(archive, data, row["clip"], columns)
                )
                for row in rows
            ]
        return cls(tuple(recordings))

    @property
    def subjects(self) -> tuple[str, ...]:
        """People, sorted."""
        return tuple(sorted({recording.subject for recording in self.recordings}))

    def of(self, subjects: Sequence[str]) -> MotionLibrary:
        """The clips of some people.

        Raises:
            InputError: one of them has none.
        """
        unknown = sorted(set(subjects) - set(self.subjects))
        if unknown or not subjects:
            raise InputError(
                f"subjects: {', '.join(unknown) or 'none'} have no clips; expected some of "
                f"{', '.join(self.subjects)}"
            )
        return self._where(lambda recording: recording.subject in subjects)

    def without(self, subjects: Sequence[str]) -> MotionLibrary:
        """The clips of everybody else."""
        return self._where(lambda recording: recording.subject not in subjects)

    def _where(self, wanted: Callable[[Recording], bool]) -> MotionLibrary:
        return MotionLibrary(tuple(r for r in self.recordings if wanted(r)))


def _landmarks(path: Path, data: np.lib.npyio.NpzFile, clip: str, columns: list[int]) -> Tensor:
    try:
        euler, root, offsets = (
            data[f"{clip}/{part}"].astype(np.float64)
            for part in ("euler_zyx_deg", "root_m", "offsets_m")
        )
    except KeyError:
        raise InputError(f"{path}: lacks clip {clip}, which the index names") from None
    places, rotation = _kinematics(np.radians(euler), root, offsets, data["parents"])
    points = places[:, columns]
    points[:, 0] += rotation[:, columns[0]] @ _CROWN
    if not np.isfinite(points).all():
        raise InputError(f"{path}: clip {clip} is not finite; remove it from the index")
    return torch.from_numpy(points.astype(np.float32))


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
