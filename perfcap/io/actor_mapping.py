"""Mapping files: which of a rig's bones are which joints, where perfcap cannot tell."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_names import ENDS
from perfcap.errors import InputError
from perfcap.io.files import MEBIBYTE, read_text

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
    values = read_toml(path, "a mapping file")
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


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The values of a small TOML file.

    Raises:
        InputError: it is missing, too large, or not TOML.
    """
    try:
        return tomllib.loads(read_text(path, what, MEBIBYTE))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not TOML ({error}); correct or restore it") from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deep; expected {what}") from None
