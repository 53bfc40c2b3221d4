"""Joint positions packed as VideoPose3D prepares them (Pavllo et al. 2019).

``data_3d_*.npz`` holds one dictionary, ``positions_3d``: subject -> action -> (F, J, 3), metres,
world. Human3.6M and HumanEva are most often passed on in this form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.datasets.layout import check_name, wrong_layout
from perfcap.io.datasets.safe_pickle import read_object_archive

_WHAT = "positions_3d, a dictionary of subjects, actions and arrays (F, J, 3)"


@dataclass(frozen=True)
class PackedPositions:
    """Where a data set has its positions.

    Attributes:
        title: of the data set.
        file: in its folder.
        layout: of the folder, in words.
        joints: J, of every pose.
    """

    title: str
    file: str
    layout: str
    joints: int

    def names(self, folder: Path) -> tuple[str, ...]:
        """Names of the sequences, ``subject/action``.

        Raises:
            InputError: the file is missing, damaged or something else.
        """
        return tuple(self._arrays(folder))

    def read(self, folder: Path, name: str) -> NDArray[np.float64]:
        """Positions of a sequence, (F, J, 3), metres.

        Raises:
            InputError: as for ``names``, no such sequence, or it holds something else.
        """
        arrays = self._arrays(folder)
        check_name(folder, self.title, name, arrays)
        return _checked(folder / self.file, name, arrays[name], self.joints)

    def _arrays(self, folder: Path) -> dict[str, Any]:
        """Arrays by name; each is checked when it is used."""
        path = folder / self.file
        if not path.is_file():
            raise wrong_layout(folder, self.title, self.file, self.layout)
        found = dict(_pairs(path, read_object_archive(path, "positions_3d", _WHAT)))
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


def _checked(path: Path, name: str, points: Any, joints: int) -> NDArray[np.float64]:
    shape = getattr(points, "shape", ())
    if not isinstance(points, np.ndarray) or len(shape) != 3 or shape[1:] != (joints, 3):
        raise InputError(
            f"{path}: {name} is {type(points).__name__} {shape}, expected (F, {joints}, 3) metres"
        )
    if points.dtype.kind != "f" or not len(points):
        raise InputError(f"{path}: {name} is {points.dtype} {shape}, expected metres")
    return points.astype(np.float64)
