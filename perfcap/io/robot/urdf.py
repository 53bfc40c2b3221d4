"""Read URDF: links on revolute, continuous and fixed joints."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from perfcap.errors import InputError
from perfcap.io.robot import shapes
from perfcap.io.robot.description import Body, Floats, Robot, RobotHinge, coupled_note
from perfcap.io.robot.elements import Element, inside, numbers, unit

_PACKAGE = "package://"
_TURNING = ("revolute", "continuous")


def read_urdf_robot(path: Path, root: Element) -> Robot:
    """The robot of a file, whose outermost element is read.

    Raises:
        InputError: it is no URDF of hinges, or names files outside of its package.
    """
    links = {link.get("name", ""): link for link in root.findall("link")}
    joints = root.findall("joint")
    children: dict[str, list[Element]] = {}
    hung: set[str] = set()
    for joint in joints:
        parent, child = _end(joint, "parent"), _end(joint, "child")
        if parent not in links or child not in links or child in hung:
            raise InputError(
                f"{path}: joint {joint.get('name')!r:.40} joins no two links of a tree; check its "
                "parent and child"
            )
        hung.add(child)
        children.setdefault(parent, []).append(joint)
    roots = [name for name in links if name not in hung]
    if len(roots) != 1:
        raise InputError(f"{path}: has {len(roots)} links that hang on none; expected one root")
    bodies: list[Body] = []
    left_out: set[str] = set()
    waiting: list[tuple[str, int, Element | None]] = [(roots[0], -1, None)]
    while waiting:
        name, above, through = waiting.pop()
        found = tuple(_surfaces(path, links[name], left_out))
        pose = np.eye(4) if through is None else _origin(through)
        hinges = () if through is None else tuple(_hinge(path, through))
        index = len(bodies)
        bodies.append(Body(name, above, pose, hinges, found))
        waiting += [(_end(j, "child"), index, j) for j in reversed(children.get(name, []))]
    notes = []
    if left_out:
        kinds = ", ".join(sorted(left_out))
        notes.append(f"{path}: its meshes in {kinds} are not read; the robot is drawn without them")
    coupled = [each.get("name", "") for each in joints if each.find("mimic") is not None]
    notes += coupled_note(path, coupled, "<mimic>")
    free = [j.get("name", "") for j in joints if j.get("type") == "revolute" and not _bounded(j)]
    if free:
        notes.append(
            f"{path}: revolute joints {', '.join(free)[:200]} have no <limit> and turn freely "
            "here; URDF wants one, or the type continuous"
        )
    return Robot(root.get("name") or path.stem, tuple(bodies), tuple(notes)).checked()


def _bounded(joint: Element) -> bool:
    limit = joint.find("limit")
    return limit is not None and {"lower", "upper"} <= set(limit.keys())


def _end(joint: Element, which: str) -> str:
    end = joint.find(which)
    return "" if end is None else end.get("link", "")


def _origin(element: Element) -> Floats:
    pose = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        turn = numbers(origin, "rpy", 3, "0 0 0")
        place = numbers(origin, "xyz", 3, "0 0 0")
        pose[:3, :3] = Rotation.from_euler("xyz", turn).as_matrix()
        pose[:3, 3] = place
    return pose


def _hinge(path: Path, joint: Element) -> Iterator[RobotHinge]:
    kind, name = joint.get("type"), joint.get("name", "")
    if kind == "fixed":
        return
    if kind not in _TURNING:
        raise InputError(
            f"{path}: joint {name!r:.40} is {kind!r:.20}; expected {', '.join(_TURNING)} or fixed"
        )
    about = joint.find("axis")
    axis = None if about is None else numbers(about, "xyz", 3)
    axis = unit(np.array([1.0, 0.0, 0.0]) if axis is None else axis, f"{path}: {name}")
    limit = joint.find("limit") if kind == "revolute" else None
    lower, upper = -math.inf, math.inf
    if limit is not None:
        both = [numbers(limit, side, 1, "0") for side in ("lower", "upper")]
        lower, upper = (float(each[0]) for each in both if each is not None)
    if not lower < upper:
        raise InputError(
            f"{path}: joint {name!r:.40} has limits {lower} to {upper}; expected lower below "
            "upper, or a fixed joint"
        )
    yield RobotHinge(name, np.zeros(3), axis, lower, upper)


def _surfaces(path: Path, link: Element, left_out: set[str]) -> Iterator[shapes.Surface]:
    """What collides, or else what is seen."""
    for part in link.findall("collision") or link.findall("visual"):
        geometry = part.find("geometry")
        for shape in () if geometry is None else geometry:
            surface = _surface(path, shape, left_out)
            if surface is not None:
                yield shapes.moved(surface, _origin(part))


def _surface(path: Path, shape: Element, left_out: set[str]) -> shapes.Surface | None:
    def one(name: str) -> float:
        found = numbers(shape, name, 1, "0")
        return 0.0 if found is None else float(found[0])

    if shape.tag == "box":
        size = numbers(shape, "size", 3, "0 0 0")
        return None if size is None else shapes.box(0.5 * size)
    if shape.tag == "sphere":
        return shapes.sphere(one("radius"))
    if shape.tag in ("cylinder", "capsule"):
        make = shapes.cylinder if shape.tag == "cylinder" else shapes.capsule
        return make(one("radius"), 0.5 * one("length"))
    if shape.tag != "mesh":
        return None
    scale = numbers(shape, "scale", 3, "1 1 1")
    file = mesh_file(path, shape.get("filename", ""))
    if file.suffix.lower() not in shapes.READ:
        left_out.add(file.suffix.lower() or "no format")
    return shapes.mesh(file, np.ones(3) if scale is None else scale)


def mesh_file(path: Path, name: str) -> Path:
    """The file of a mesh, in the folder of the URDF or in that of the package it is part of."""
    name = name.removeprefix("file://")
    if not name.startswith(_PACKAGE):
        return inside(path.parent, name)
    package, _, rest = name.removeprefix(_PACKAGE).lstrip("/").partition("/")
    folders = [folder for folder in path.resolve().parents if folder.name == package != ""]
    return inside(folders[0] if folders else path.resolve().parent, rest)
