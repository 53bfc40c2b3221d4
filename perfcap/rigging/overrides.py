"""Regions of a mesh that only some bones may move: skirts, long coats, bags."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, read_toml
from perfcap.setting_checks import require_count

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LIMIT, _MOST = MEBIBYTE, 200
_KEYS = {"name", "part", "box", "bones", "blend"}


@dataclass(frozen=True)
class Override:
    """A region and the bones that may move it.

    Attributes:
        name: for messages.
        bones: joints of the skeleton, at least one.
        part: connected part of the mesh by falling area, 0 the largest; any if None.
        box: lowest and highest corner, metres in the rest pose, y up; anywhere if None.
        blend: metres over which weights are blurred within the region and across its seam.
    """

    name: str
    bones: tuple[str, ...]
    part: int | None = None
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    blend: float = 0.03

    def __post_init__(self) -> None:
        unknown = [bone for bone in self.bones if bone not in JOINTS]
        if unknown or not self.bones:
            raise InputError(
                f"override {self.name!r}: bones are {list(self.bones)}; expected some of "
                f"{', '.join(JOINTS)}"
            )
        if self.part is None and self.box is None:
            raise InputError(f"override {self.name!r} has neither part nor box; give one or both")
        if self.part is not None:
            require_count(self.part, f"part of override {self.name!r}", least=0)
        if not 0 <= self.blend < 1:
            raise InputError(f"override {self.name!r}: blend is {self.blend}; expected metres")

    def covers(self, places: Floats, component: NDArray[np.int64]) -> Flags:
        """Which places (U, 3) of the parts (U,) are in the region, (U,)."""
        inside = np.ones(len(places), dtype=np.bool_)
        if self.part is not None:
            inside &= component == self.part
        if self.box is not None:
            low, high = np.array(self.box)
            inside &= ((places >= low) & (places <= high)).all(1)
        return inside


def read_overrides(path: Path) -> tuple[Override, ...]:
    """Read a TOML file of ``[[region]]`` tables.

    ::

        [[region]]
        name = "skirt"
        part = 1                                        # and / or
        box = [[-0.5, 0.4, -0.5], [0.5, 1.0, 0.5]]      # metres
        bones = ["pelvis", "l_hip", "r_hip"]
        blend = 0.05

    Raises:
        InputError: the file cannot be read, or a region is not as above.
    """
    what = "regions and their bones (TOML)"
    tables = read_toml(path, what, _LIMIT).get("region", [])
    if not isinstance(tables, list) or not 0 < len(tables) <= _MOST:
        raise InputError(f"{path}: has no [[region]] tables; expected 1 to {_MOST} of them")
    return tuple(_override(path, number, table) for number, table in enumerate(tables, 1))


def _override(path: Path, number: int, table: Any) -> Override:
    where = f"{path}: region {number}"
    if not isinstance(table, dict) or set(table) - _KEYS or "bones" not in table:
        raise InputError(f"{where}: expected bones, and any of {', '.join(sorted(_KEYS))}")
    try:
        box = table.get("box")
        if box is not None:
            corners = np.array(box, dtype=np.float64)
            if corners.shape != (2, 3) or not (corners[0] < corners[1]).all():
                raise ValueError(f"box is {box}")
            low, high = ((float(x), float(y), float(z)) for x, y, z in corners)
            box = (low, high)
        part = table.get("part")
        return Override(
            name=str(table.get("name", f"region {number}")),
            bones=tuple(str(bone) for bone in table["bones"]),
            part=None if part is None else int(part),
            box=box,
            blend=float(table.get("blend", Override.blend)),
        )
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{where}: {error}; expected part = number, box = [[x, y, z], [x, y, z]] with the "
            'lowest corner first, bones = ["pelvis", ...], blend = metres'
        ) from error
