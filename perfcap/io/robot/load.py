"""A robot's file as an actor: its own hinges and limits, on which a person's motion is solved."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.rig import Hinge, Rig
from perfcap.actor.template import Template
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.actor_import import ActorMapping
from perfcap.io.robot.description import Floats, Robot, RobotHinge
from perfcap.io.robot.elements import read_xml
from perfcap.io.robot.mjcf import read_mjcf_robot
from perfcap.io.robot.roles import person_bodies
from perfcap.io.robot.shapes import stick
from perfcap.io.robot.urdf import read_urdf_robot

_LOG = logging.getLogger(__name__)
ROBOTS = (".urdf", ".xml", ".mjcf")
_SAME = 1e-9  # m
_LARGEST = 20.0  # m, of a robot as drawn
_CHAINS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
_LARGE = 0.5  # least cosine of an axis of the person to one of the file's
_UPRIGHT = 0.985  # cosine of a shank's lean from which its foot is drawn with it
_HEAD = 0.1  # m, above the head's joint, where the head has no shape
_TOE = 0.15  # m, before the ankle, where the foot has no shape
_FRONT = 0.005  # m, of a foot, in whose middle its tip is
_THIN = 0.015  # m, of sticks


def is_robot(path: str | Path) -> bool:
    """Whether a name ends like that of a robot."""
    return Path(path).suffix.lower() in ROBOTS


def read_robot(path: Path) -> Robot:
    """The robot of a URDF or MJCF.

    Raises:
        InputError: it is neither, or breaks a limit of the reader.
    """
    root = read_xml(path, "a URDF or MJCF")
    readers = {"robot": read_urdf_robot, "mujoco": read_mjcf_robot}
    if root.tag not in readers:
        raise InputError(
            f"{path}: starts with <{root.tag[:40]}>; expected a URDF's <robot> or an MJCF's "
            "<mujoco>"
        )
    return readers[root.tag](path, root)


def load_robot(path: str | Path, mapping: ActorMapping | None = None) -> Actor:
    """The actor of a humanoid, in metres, y up, facing +z, resting as its file draws it.

    Bodies are its bones, and joints are where hinges are; hinges of one body at several places get
    a joint for each place. Angles are those of the file, so that they are its ``qpos``.

    Args:
        path: a URDF or MJCF.
        mapping: bodies of joints, where names do not tell.

    Raises:
        InputError: it cannot be read, or its limbs are not found.
    """
    path = Path(path)
    robot = read_robot(path)
    for note in robot.notes:
        _LOG.warning("%s", note)
    bodies = person_bodies(robot, _said(mapping or ActorMapping()))
    joints = _Joints(robot)
    pose = _upright(robot, bodies, joints)
    roles = tuple(joints.of_body[bodies[name]] for name in JOINTS)
    _require_metres(path, robot)
    vertices, faces, owners = _mesh(robot, joints, pose)
    rest = pose @ np.array(joints.poses)
    feet = {side: robot.below(bodies[f"{side}_ankle"]) for side in "lr"}
    own = {name: joints.of_body[body] for name, body in bodies.items()}
    points = _landmarks(robot, own, rest, vertices, owners, feet, joints)
    rig = Rig(
        joints=tuple(joints.names),
        parents=tuple(joints.parents),
        positions=torch.tensor(rest[:, :3, 3]),
        hinges=tuple(_hinge(joints, pose, number) for number in range(len(joints.hinges))),
        landmarks=LANDMARKS,
        landmark_joints=tuple(points[name][0] for name in LANDMARKS),
        landmark_positions=torch.tensor(np.array([points[name][1] for name in LANDMARKS])),
        roles=roles,
        neutral=torch.tensor(_neutral(rest[list(roles), :3, 3])),
    )
    template = Template(
        vertices=vertices,
        faces=faces,
        bone_names=rig.joints,
        bone_parents=np.array(joints.parents),
        bone_rest=rest,
        weight_bones=owners[:, None],
        weights=np.ones((len(vertices), 1)),
        name=path.stem,
        landmarks={name: (joint, place) for name, (joint, place) in points.items()},
    )
    return Actor(template, rig)


def _require_metres(path: Path, robot: Robot) -> None:
    """Refuse bodies or shapes of a size that no robot has."""
    span = float(np.ptp(robot.world()[:, :3, 3], axis=0).max())
    if span > _LARGEST:
        raise InputError(
            f"{path}: its bodies lie {span:.4g} apart as drawn, expected a robot in metres; divide "
            "places in millimetres by 1000, those in centimetres by 100"
        )
    for body in robot.bodies:
        for points, _ in body.shapes:
            size = float(np.ptp(points, axis=0).max())
            if size > _LARGEST:
                raise InputError(
                    f"{path}: a shape of {body.name!r:.40} is {size:.4g} across, expected metres; "
                    'meshes in millimetres need scale="0.001 0.001 0.001"'
                )


def _said(mapping: ActorMapping) -> Mapping[str, str]:
    """What a mapping file may say of robots: bodies of joints."""
    ends = sorted(set(mapping.joints) - set(JOINTS))
    unit = [] if mapping.metres_per_unit is None else ["metres_per_unit"]
    if ends or unit:
        raise InputError(
            f"--mapping: {', '.join([*unit, *ends])} cannot be said of a robot, which is in metres "
            "and whose shapes tell where its head and toes end; name bodies of joints only"
        )
    return mapping.joints


def _neutral(at: Floats) -> Floats:
    """Turns (16, 3, 3) from rest to the neutral pose, of joints at (16, 3).

    Robots are drawn upright, so trunk, head and feet stay; limbs turn by the least that makes them
    hang. Feet go along with shanks that are drawn far from upright.
    """
    turns = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    limbs = [(f"{s}_{a}", f"{s}_{b}") for s in "lr" for c in _CHAINS for a, b in pairwise(c)]
    for start, end in limbs:
        a, b = JOINTS.index(start), JOINTS.index(end)
        along = (at[b] - at[a]) / max(float(np.linalg.norm(at[b] - at[a])), _SAME)
        turns[a] = _least_turn(along)
    for side in "lr":
        knee, ankle = JOINTS.index(f"{side}_knee"), JOINTS.index(f"{side}_ankle")
        if np.trace(turns[knee]) < 1 + 2 * _UPRIGHT:
            turns[ankle] = turns[knee]
    return turns


def _least_turn(along: Floats) -> Floats:
    """The smallest rotation (3, 3) that makes a unit vector point down."""
    axis = np.cross(along, (0.0, -1.0, 0.0))
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, -along[1])
    about = axis / sine if sine > _SAME else np.array([1.0, 0.0, 0.0])
    found: Floats = Rotation.from_rotvec(angle * about).as_matrix()
    return found


class _Joints:
    """Joints of the rig: one for each place at which hinges of a body are, and one a body."""

    def __init__(self, robot: Robot) -> None:
        self.names: list[str] = []
        self.parents: list[int] = []
        self.poses: list[Floats] = []  # joint to the file's world, as drawn
        self.hinges: list[tuple[int, RobotHinge]] = []
        self.of_body: list[int] = []
        world = robot.world()
        for index, body in enumerate(robot.bodies):
            parent = -1 if body.parent < 0 else self.of_body[body.parent]
            places = _places(body.hinges)
            for number, (anchor, hinges) in enumerate(places):
                last = number == len(places) - 1
                pose = world[index].copy()
                pose[:3, 3] = world[index, :3, :3] @ anchor + pose[:3, 3]
                name = body.name if last else f"{body.name}.{hinges[-1].name}"
                parent = self._add(name, parent, pose)
                self.hinges += [(parent, hinge) for hinge in hinges]
            self.of_body.append(parent if places else self._add(body.name, parent, world[index]))

    def _add(self, name: str, parent: int, pose: Floats) -> int:
        self.names.append(name)
        self.parents.append(parent)
        self.poses.append(pose)
        return len(self.names) - 1


def _places(hinges: tuple[RobotHinge, ...]) -> list[tuple[Floats, list[RobotHinge]]]:
    """Hinges in order, grouped while they are at one place."""
    found: list[tuple[Floats, list[RobotHinge]]] = []
    for hinge in hinges:
        if found and np.abs(found[-1][0] - hinge.anchor).max() < _SAME:
            found[-1][1].append(hinge)
        else:
            found.append((hinge.anchor, [hinge]))
    return found


def _upright(robot: Robot, bodies: Mapping[str, int], joints: _Joints) -> Floats:
    """What turns the file's axes to y up, facing +z, and puts the hips over the origin, (4, 4)."""
    at = {name: joints.poses[joints.of_body[body]][:3, 3] for name, body in bodies.items()}
    up = at["l_shoulder"] + at["r_shoulder"] - at["l_ankle"] - at["r_ankle"]
    left = at["l_hip"] - at["r_hip"]
    axes = []
    for wanted in (left, up):
        size = float(np.linalg.norm(wanted))
        largest = int(np.abs(wanted).argmax())
        if not size > 0 or abs(wanted[largest]) < _LARGE * size:
            raise InputError(
                f"{robot.name}: does not stand as it is drawn; expected its shoulders over its "
                "feet along an axis, and its left hip along another"
            )
        axes.append(np.sign(wanted[largest]) * np.eye(3)[largest])
    if axes[0] @ axes[1]:
        raise InputError(f"{robot.name}: its hips lie one over the other; check --mapping")
    pose = np.eye(4)
    pose[:3, :3] = np.stack((axes[0], axes[1], np.cross(axes[0], axes[1])))
    return pose


def _mesh(robot: Robot, joints: _Joints, pose: Floats) -> tuple[Floats, np.ndarray, np.ndarray]:
    """Vertices (V, 3), faces (T, 3) and the joint of each vertex; sticks where there are none."""
    vertices: list[Floats] = []
    faces: list[np.ndarray] = []
    owners: list[int] = []
    count = 0
    world = pose @ robot.world()
    parts = [
        (joints.of_body[index], points @ world[index, :3, :3].T + world[index, :3, 3], triangles)
        for index, body in enumerate(robot.bodies)
        for points, triangles in body.shapes
    ]
    for joint, points, triangles in parts or _sticks(joints, pose):
        vertices.append(points)
        faces.append(triangles + count)
        owners += [joint] * len(points)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(faces), np.array(owners)


def _sticks(joints: _Joints, pose: Floats) -> list[tuple[int, Floats, np.ndarray]]:
    places = (pose @ np.array(joints.poses))[:, :3, 3]
    return [
        (parent, *stick(places[parent], places[joint], _THIN))
        for joint, parent in enumerate(joints.parents)
        if parent >= 0 and np.linalg.norm(places[joint] - places[parent]) > 1e-3
    ]


def _landmarks(
    robot: Robot,
    own: Mapping[str, int],
    rest: Floats,
    vertices: Floats,
    owners: np.ndarray,
    feet: Mapping[str, list[int]],
    joints: _Joints,
) -> dict[str, tuple[int, Floats]]:
    """Joint and rest place of the sixteen landmarks."""
    points = {name: (own[name], rest[own[name], :3, 3]) for name in LANDMARKS if name in own}
    shoulders = np.mean([rest[own[f"{side}_shoulder"], :3, 3] for side in "lr"], axis=0)
    points["neck"] = (own["spine"], shoulders)
    head = own["head"]
    shape = vertices[owners == head]
    above = rest[head, :3, 3] + [0.0, _HEAD, 0.0]
    points["head_top"] = (head, shape[shape[:, 1].argmax()] if len(shape) else above)
    if points["head_top"][1][1] <= shoulders[1]:
        points["head_top"] = (head, shoulders + np.array([0.0, 2 * _HEAD, 0.0]))
    for side in "lr":
        ankle = own[f"{side}_ankle"]
        shape = vertices[np.isin(owners, [joints.of_body[body] for body in feet[side]])]
        toe = rest[ankle, :3, 3] + [0.0, 0.0, _TOE]
        front = shape[shape[:, 2] > shape[:, 2].max() - _FRONT] if len(shape) else toe[None]
        points[f"{side}_toe"] = (ankle, front.mean(0))
    return points


def _hinge(joints: _Joints, pose: Floats, number: int) -> Hinge:
    joint, hinge = joints.hinges[number]
    axis = pose[:3, :3] @ joints.poses[joint][:3, :3] @ hinge.axis
    about = float(axis[0]), float(axis[1]), float(axis[2])
    return Hinge(hinge.name, joints.names[joint], about, hinge.lower, hinge.upper, hinge.rest)
