"""Joint angles and a model of the person's bones for OpenSim: ``.mot`` and ``.osim``.

Coordinates have the names, axes and signs of OpenSim's full-body models (Rajagopal et al. 2016):
flexion, adduction and inward rotation are positive, trunk and pelvis turn about z (right), x
(ahead) and y (up) in this order. Knees and elbows turn about the actor's own axes: the pair
puts every joint where the capture has it, in the world of the other formats with y up. The model is
for kinematics: it has no muscles, and its masses are placeholders.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from perfcap.actor.anatomy import JOINTS, PARENTS
from perfcap.actor.joint_angles import joint_angles
from perfcap.actor.kinematic_tree import Pose
from perfcap.actor.skeleton import Skeleton
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.atomic import writing
from perfcap.io.export.options import Options
from perfcap.io.export.osim_text import OsimJoint, osim_text
from perfcap.io.export.recording import Floats, Recording
from perfcap.io.moving_rig import read_moving_rig

AHEAD_UP_RIGHT = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # from left, up, ahead
_BALLS = {
    "pelvis": ("pelvis_tilt", "pelvis_list", "pelvis_rotation"),
    "spine": ("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
    "neck": ("neck_extension", "neck_bending", "neck_rotation"),
    "shoulder": ("arm_flex", "arm_add", "arm_rot"),
    "hip": ("hip_flexion", "hip_adduction", "hip_rotation"),
    "ankle": ("ankle_angle", "subtalar_angle", "foot_rotation"),
}
_HINGES = {
    "head_nod": "head_flexion",
    "elbow_flexion": "elbow_flex",
    "knee_flexion": "knee_angle",
}
_BODIES = {
    "spine": "torso", "shoulder": "humerus", "elbow": "ulna", "wrist": "hand", "hip": "femur",
    "knee": "tibia", "ankle": "foot",
}  # fmt: skip
_PLACES = ("pelvis_tx", "pelvis_ty", "pelvis_tz")


@dataclass(frozen=True)
class _Moving:
    """Joints in a world with y up: turns of bodies with OpenSim's axes from the neutral pose
    (F, 16, 3, 3), places (F, 16, 3) m.
    """

    skeleton: Skeleton
    neutral: Pose
    turn: Floats
    place: Floats
    angles: Floats


def write_osim(folder: Path, recording: Recording, options: Options) -> None:
    """A model with the person's bones, and the motion of its coordinates in degrees.

    Raises:
        InputError: the motion is a robot's.
    """
    moving = _moving(recording)
    joints = tuple(_joints(moving))
    columns = {
        c: v for joint in joints for c, v in zip(joint.coordinates, joint.values, strict=True)
    }
    degrees = {c: np.degrees(np.unwrap(v)) for c, v in columns.items()}
    degrees |= dict(zip(_PLACES, moving.place[:, 0].T, strict=True))
    with writing(folder / f"{recording.name}.mot") as file:
        file.write(_mot(recording, degrees).encode())
    owners = list(moving.skeleton.rig.landmark_joints)
    seen = recording.landmarks - moving.place[:, owners]  # F 16 3
    local = np.einsum("fjba,fjb->fja", moving.turn[:, owners], seen).mean(0)
    markers = [
        (name, _body(JOINTS[owner]), place)
        for name, owner, place in zip(LANDMARKS, owners, local, strict=True)
    ]
    with writing(folder / f"{recording.name}.osim") as file:
        file.write(osim_text(escape(recording.name), joints, markers).encode())


def _moving(recording: Recording) -> _Moving:
    if isinstance(recording.result.report.get("robot"), dict):
        raise InputError("--to osim: the motion is a robot's; export that of a person")
    numbers = recording.numbers
    rig = read_moving_rig(recording.result.folder, slice(int(numbers[0]), int(numbers[-1]) + 1))
    skeleton = rig.actor.skeleton
    rest = skeleton.rest_motion()
    neutral = skeleton(replace(rest, angles=torch.zeros_like(rest.angles)))
    turn = rig.rotation @ neutral.rotation[0, : len(JOINTS)].mT.numpy()
    return _Moving(
        skeleton,
        neutral,
        recording.upright @ turn @ AHEAD_UP_RIGHT.T,
        rig.position @ recording.upright.T,
        joint_angles(skeleton, torch.tensor(rig.rotation)).numpy(),
    )


def _joints(moving: _Moving) -> Iterator[OsimJoint]:
    rest = moving.neutral.position[0].numpy()
    turns = moving.neutral.rotation[0].numpy()
    for number, joint in enumerate(JOINTS):
        above = PARENTS[joint]
        parent = -1 if above is None else JOINTS.index(above)
        own = moving.turn[:, number]
        offset = np.zeros(3)
        if parent >= 0:
            own = moving.turn[:, parent].mT @ own
            offset = AHEAD_UP_RIGHT @ (rest[number] - rest[parent])
        kind, side = _kind(joint)
        if kind in _BALLS:
            found = Rotation.from_matrix(own).as_euler("ZXY").T
            if parent < 0:  # people may head and lean anywhere in the world
                found = _steady(found)
            sign = np.array([1.0, -1.0, -1.0] if side == "l" else [1.0, 1.0, 1.0])
            names = tuple(name + (f"_{side}" if side else "") for name in _BALLS[kind])
            axes = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]) * sign[:, None]
            values = found * sign[:, None]
        else:
            rows = [n for n, h in enumerate(moving.skeleton.rig.hinges) if h.joint == joint]
            hinges = [moving.skeleton.rig.hinges[row] for row in rows]
            names = tuple(_hinge_name(hinge.name) for hinge in hinges)
            turned = turns[parent] @ moving.skeleton.tree.axes[rows].numpy()[..., None]
            axes = (AHEAD_UP_RIGHT @ turned)[..., 0]
            values = moving.angles[:, rows].T
        at = tuple(_PLACES) if parent < 0 else ()
        above_body = "" if parent < 0 else _body(JOINTS[parent])
        yield OsimJoint(joint, _body(joint), above_body, offset, names, axes, values, at)


def _steady(angles: Floats) -> Floats:
    """The same turns about z, x, y, (3, F), of the two ways to write each the one that jumps less.

    Frames that lean sideways by more than a quarter turn would all jump by half a turn otherwise.
    """
    found = angles.copy()
    other = np.stack((angles[0] + np.pi, np.pi - angles[1], angles[2] + np.pi))
    for frame in range(1, found.shape[1]):
        ways = np.stack((angles[:, frame], other[:, frame]))
        apart = np.abs(np.remainder(ways - found[:, frame - 1] + np.pi, 2 * np.pi) - np.pi).sum(1)
        found[:, frame] = ways[int(apart.argmin())]
    return found


def _kind(joint: str) -> tuple[str, str]:
    return (joint[2:], joint[0]) if joint[:2] in ("l_", "r_") else (joint, "")


def _body(joint: str) -> str:
    kind, side = _kind(joint)
    return _BODIES.get(kind, kind) + (f"_{side}" if side else "")


def _hinge_name(name: str) -> str:
    kind, side = _kind(name)
    return _HINGES[kind] + (f"_{side}" if side else "")


def _mot(recording: Recording, columns: dict[str, Floats]) -> str:
    lines = [
        recording.name,
        "version=1",
        f"nRows={recording.frames}",
        f"nColumns={1 + len(columns)}",
        "inDegrees=yes",
        "",
        "Angles are in degrees, places in metres.",
        "",
        "endheader",
        "\t".join(("time", *columns)),
    ]
    rows = np.stack((recording.times, *columns.values()), 1)
    lines += ["\t".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"
