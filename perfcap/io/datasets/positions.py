"""Joint positions packed as VideoPose3D prepares them (Pavllo et al. 2019).

``data_3d_*.npz`` holds one dictionary, ``positions_3d``: subject -> action -> (F, J, 3), metres,
world. Human3.6M and HumanEva are most often passed on in this form.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.datasets.safe_pickle import read_object_archive

_WHAT = "positions_3d, a dictionary of subjects, actions and arrays (F, J, 3)"


def read_positions(path: Path) -> dict[str, Any]:
    """Arrays by ``subject/action``; each is checked when it is used.

    Raises:
        InputError: the file is missing, damaged or something else.
    """
    subjects = read_object_archive(path, "positions_3d", _WHAT)
    found = dict(_pairs(path, subjects))
    if not found:
        raise InputError(f"{path}: holds no action of any subject; expected {_WHAT}")
    return found


def _pairs(path: Path, subjects: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(subjects, dict):
        raise InputError(f"{path}: positions_3d is {type(subjects).__name__}; expected {_WHAT}")
    for subject, actions in subjects.items():
        if not isinstance(actions, dict):
            kind = type(actions).__name__
            raise InputError(f"{path}: subject {subject!s:.20} is {kind}; expected {_WHAT}")
        for action, points in actions.items():
            yield f"{subject}/{action}", points


def checked_positions(path: Path, name: str, points: Any, joints: int) -> NDArray[np.float64]:
    """Positions (F, joints, 3) of a sequence.

    Raises:
        InputError: they are something else.
    """
    shape = getattr(points, "shape", ())
    if not isinstance(points, np.ndarray) or len(shape) != 3 or shape[1:] != (joints, 3):
        raise InputError(
            f"{path}: {name} is {type(points).__name__} {shape}, expected (F, {joints}, 3) metres"
        )
    if points.dtype.kind != "f" or not len(points):
        raise InputError(f"{path}: {name} is {points.dtype} {shape}, expected metres")
    return points.astype(np.float64)
