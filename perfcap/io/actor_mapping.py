"""Mapping files: which of a rig's bones are which joints, where perfcap cannot tell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_names import ENDS
from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, read_toml

_UNIT = "metres_per_unit"


@dataclass(frozen=True)
class ActorMapping:
    """What a user says about a rig.

    Attributes:
        joints: names of bones by joint or landmark.
        metres_per_unit: length of the file's unit, None to guess it from the height.
    """

    joints: Mapping[str, str] = field(default_factory=dict)
    metres_per_unit: float | None = None


def read_mapping(path: Path) -> ActorMapping:
    """Read lines such as ``pelvis = "Bip01 Pelvis"`` and ``metres_per_unit = 0.01``.

    Raises:
        InputError: the file is not TOML, or says something else.
    """
    values = read_toml(path, "a mapping file", MEBIBYTE)
    unit = values.pop(_UNIT, None)
    if unit is not None and not (
        isinstance(unit, float | int) and math.isfinite(unit) and 1e-6 < unit < 1e6
    ):
        raise InputError(f"{path}: {_UNIT} is {unit!r:.40}; expected metres, such as 0.01")
    for joint, bone in values.items():
        if joint not in (*JOINTS, *ENDS):
            known = ", ".join((*JOINTS, *ENDS, _UNIT))
            raise InputError(f"{path}: {joint!r:.40} is no joint; expected some of {known}")
        if not isinstance(bone, str):
            raise InputError(f"{path}: {joint} is {bone!r:.40}; expected the name of a bone")
    return ActorMapping(values, unit)
