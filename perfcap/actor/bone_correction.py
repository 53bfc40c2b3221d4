"""Turn and scale a rig into metres, y up, facing +z, whatever its file meant by its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.bone_space import BoneSpace
from perfcap.actor.template import Template
from perfcap.errors import InputError

Floats = NDArray[np.float64]

# where a mapping file goes: of an actor, and of the source of ``perfcap retarget``
GIVEN_AS = "--mapping (--source-mapping: of motion to retarget)"
SHORTEST, TALLEST = 1.2, 2.3  # m, of a grown person
_SMALL, _LARGE = 0.5, 3.0  # m, of children and of heroes: believed, but not guessed
UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "inches": 0.0254,
    "decimetres": 0.1,
    "feet": 0.3048,
    "tens of metres": 10.0,
    "hundreds of metres": 100.0,
}
_FLOATING, _AWAY = 0.05, 0.5  # m: further from the ground or the origin, a person is moved there


@dataclass(frozen=True, eq=False)
class Correction:
    """What takes a file's coordinates to metres, y up, facing +z.

    Attributes:
        scale: metres per unit of the file.
        rotation: turn by right angles, (3, 3).
        offset: m, (3,).
    """

    scale: float
    rotation: Floats
    offset: Floats

    @property
    def matrix(self) -> Floats:
        """The similarity (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.scale * self.rotation
        matrix[:3, 3] = self.offset
        return matrix

    @property
    def up(self) -> str:
        """The axis of the file that points up, such as ``z``."""
        return axis_name(self.rotation[1])

    @property
    def ahead(self) -> str:
        """The axis of the file that the person faces, such as ``-y``."""
        return axis_name(self.rotation[2])

    def apply(self, template: Template) -> Template:
        """The template in metres; its ``space`` keeps what it was, for animations."""
        if np.array_equal(self.matrix, np.eye(4)):
            return template
        linear, rest = self.matrix[:3, :3], template.bone_rest.copy()
        rest[:, :3, :3] = self.rotation @ rest[:, :3, :3]
        rest[:, :3, 3] = rest[:, :3, 3] @ linear.T + self.offset
        space = template.space or BoneSpace(np.ones(len(rest)), np.eye(4))
        return replace(
            template,
            vertices=template.vertices @ linear.T + self.offset,
            bone_rest=rest,
            landmarks={
                name: (bone, linear @ place + self.offset)
                for name, (bone, place) in template.landmarks.items()
            },
            space=space.moved(self.matrix),
        ).rounded()


def find_correction(
    template: Template,
    joints: Mapping[str, int],
    metres_per_unit: float | None = None,
) -> Correction:
    """How a rig has to be turned, scaled and moved.

    Args:
        template: as its file has it.
        joints: bone of each joint, with left and right as they are.
        metres_per_unit: length of the file's unit, guessed from the height where None.

    Raises:
        InputError: a height that no unit makes that of a person.
    """
    at = {name: template.bone_rest[bone, :3, 3] for name, bone in joints.items()}
    rotation = upright(at)
    vertices = template.vertices @ rotation.T
    height = float(np.ptp(vertices[:, 1]))
    scale = unit_of(template.name, height) if metres_per_unit is None else metres_per_unit
    vertices *= scale
    low, pelvis = float(vertices[:, 1].min()), scale * (rotation @ at["pelvis"])
    moved = abs(low) > _FLOATING or float(np.hypot(pelvis[0], pelvis[2])) > _AWAY
    offset = np.array([-pelvis[0], -low, -pelvis[2]]) if moved else np.zeros(3)
    return Correction(scale, rotation, offset)


def upright(at: Mapping[str, Floats]) -> Floats:
    """The turn by right angles that brings a body nearest to y up, facing +z, (3, 3)."""
    up = at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"])
    left = at["l_hip"] - at["r_hip"] + at["l_shoulder"] - at["r_shoulder"]
    ahead = np.cross(left, up)
    rows = np.zeros((3, 3))
    rows[1, np.abs(up).argmax()] = np.sign(up[np.abs(up).argmax()]) or 1.0
    ahead = np.where(rows[1] != 0, 0.0, ahead)
    rows[2, np.abs(ahead).argmax()] = np.sign(ahead[np.abs(ahead).argmax()]) or 1.0
    if not np.any(ahead):
        raise InputError("actor has hips, shoulders and neck on one line; check its rest pose")
    rows[0] = np.cross(rows[1], rows[2])
    return rows


def unit_of(name: str, height: float) -> float:
    """Metres per unit, such that a height is that of a person.

    Raises:
        InputError: no unit does.
    """
    for metres in UNITS.values():
        if SHORTEST <= metres * height <= TALLEST:
            return metres
    if _SMALL <= height <= _LARGE:
        return 1.0
    raise InputError(
        f"actor {name!r}: is {height:.4g} units tall, which no unit makes the height of a person "
        f"({SHORTEST} to {TALLEST} m); state metres_per_unit in a mapping file, given as {GIVEN_AS}"
    )


def unit_name(scale: float) -> str:
    """What a unit is called."""
    return {metres: name for name, metres in UNITS.items()}.get(scale, f"units of {scale:.4g} m")


def axis_name(direction: Floats) -> str:
    """Name of a signed axis, such as ``-y``."""
    index = int(np.abs(direction).argmax())
    return ("-" if direction[index] < 0 else "") + "xyz"[index]
