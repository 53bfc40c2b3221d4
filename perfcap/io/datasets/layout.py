"""Folders in the layout of a data set, or one line about what was expected where."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import JointSet, map_to_landmarks
from perfcap.errors import InputError
from perfcap.io.files import natural_key

MAX_FRAMES = 1_000_000
MAX_OTHERS = 16  # people beside the one of a sequence whose joints are read with it
_FARTHEST = 1e9  # metres or pixels; a joint out there is no measurement


def wrong_layout(folder: Path, title: str, missing: str, expected: str) -> InputError:
    """A folder that lacks what a data set has, in one line."""
    if not folder.is_dir():
        return InputError(f"{folder}: no such folder; expected {title}: {expected}")
    names = sorted((entry.name for entry in folder.iterdir()), key=natural_key)
    held = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    return InputError(
        f"{folder}: has no {missing}; expected {title} as it is published: {expected}; the folder "
        f"holds {held or 'nothing'}; name the folder above or below, or unpack the data there"
    )


def check_name(folder: Path, title: str, name: str, names: Iterable[str]) -> None:
    """Refuse a sequence that is not there.

    Raises:
        InputError: says which there are.
    """
    known = list(names)
    if name not in known:
        some = ", ".join(known[:6]) + (f" and {len(known) - 6} more" if len(known) > 6 else "")
        raise InputError(f"{folder}: has no sequence {name!r:.80} of {title}; it has {some}")


def matching(folder: Path, pattern: str) -> list[Path]:
    """Files and folders that match a pattern, in natural order; none if there is no folder."""
    found = folder.glob(pattern) if folder.is_dir() else ()
    return sorted(found, key=lambda path: natural_key(str(path.relative_to(folder))))


def array_of(
    where: str, values: object, shape: Sequence[int | None], kinds: str = "fiu"
) -> NDArray[np.float64]:
    """An array of numbers of a shape, in which None is any length.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(values, np.ndarray):
        raise InputError(f"{where}: is {type(values).__name__}, expected an array of numbers")
    expected = "(" + ", ".join("n" if side is None else str(side) for side in shape) + ")"
    fits = len(shape) == values.ndim and all(
        side is None or side == found for side, found in zip(shape, values.shape, strict=True)
    )
    if not fits or values.dtype.kind not in kinds or values.shape[:1] > (MAX_FRAMES,):
        raise InputError(f"{where}: is {values.dtype} {values.shape}, expected numbers {expected}")
    return values.astype(np.float64)


def landmarks_of(points: NDArray[np.float64], joint_set: JointSet, scale: float = 1.0) -> Tensor:
    """The 16 landmarks (..., 16, d) of joints (..., J, d), NaN where there are none.

    Args:
        points: NaN where a joint is unknown; so are those too far away for any recording.
        joint_set: names of the J joints.
        scale: what makes metres of the file's unit.
    """
    values = torch.from_numpy(points) * scale
    known = (values.abs() < _FARTHEST).all(-1).to(values.dtype)
    values = torch.where(known.unsqueeze(-1) > 0, values, 0)  # NaN times zero is NaN
    mapped, found = map_to_landmarks(values, known, joint_set, measured=True)
    return torch.where(found.unsqueeze(-1) > 0, mapped, torch.nan)


def at_frames(joints: Tensor, numbers: Sequence[int], wanted: Sequence[int]) -> Tensor:
    """Joints (W, 16, 3) of the wanted frames, NaN where they have no such frame.

    Args:
        joints: (F, 16, 3), metres.
        numbers: of their frames, F.
        wanted: numbers of W frames.
    """
    rows = {number: row for row, number in enumerate(numbers)}
    nothing = torch.full_like(joints[0], torch.nan)
    return torch.stack([joints[rows[n]] if n in rows else nothing for n in wanted])


def named_below(name: str, names: Iterable[str]) -> tuple[str, ...]:
    """The people ``NAME/...`` among names of sequences; the name itself where there are none."""
    return tuple(each for each in names if each.startswith(f"{name}/")) or (name,)


def measured(points: NDArray[np.float64]) -> Tensor:
    """Points (..., d), NaN where a coordinate is unknown or too far away for any recording."""
    values = torch.from_numpy(points)
    return torch.where((values.abs() < _FARTHEST).all(-1, keepdim=True), values, torch.nan)


def present(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Those of some files that are there."""
    return tuple(path for path in paths if path.exists())
