"""Attributes of MJCF elements with those of their classes, and what the compiler is told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from perfcap.errors import InputError
from perfcap.io.robot.description import Floats
from perfcap.io.robot.elements import Element, inside, numbers, read_xml, unit

MAIN = "main"
_FILES = 50
_AXES = "xyzXYZ"


@dataclass(frozen=True)
class Rules:
    """How a file is to be read.

    Attributes:
        degrees: whether angles are.
        euler: order of the axes; capitals stand still.
        limited: whether a range alone makes a limit.
        meshes: folder of the meshes.
        classes: default attributes by class and tag.
        assets: elements of meshes by name.
    """

    degrees: bool
    euler: str
    limited: bool
    meshes: Path
    classes: Mapping[str, Mapping[str, Mapping[str, str]]]
    assets: Mapping[str, Element] = field(default_factory=dict)

    def with_defaults(self, element: Element, inherited: str) -> Element:
        """The element with the attributes that its class, or that of its body, gives it."""
        name = element.get("class", inherited)
        if name not in self.classes:
            raise InputError(f"<{element.tag}>: its class {name!r:.40} is not in <default>")
        return Element(element.tag, {**self.classes[name].get(element.tag, {}), **element.attrib})

    def angle(self, value: float) -> float:
        """Radians."""
        return math.radians(value) if self.degrees else value

    def pose(self, element: Element) -> Floats:
        """Place and orientation of a body or shape, (4, 4)."""
        found = np.eye(4)
        found[:3, 3] = numbers(element, "pos", 3, "0 0 0")
        found[:3, :3] = self._turn(element)
        return found

    def _turn(self, element: Element) -> Floats:
        what = f"<{element.tag} name={element.get('name', '')!r:.40}>"
        if (quat := numbers(element, "quat", 4)) is not None:
            return rotation_of(quat, what)
        if (turn := numbers(element, "axisangle", 4)) is not None:
            return _matrix(Rotation.from_rotvec(unit(turn[:3], what) * self.angle(float(turn[3]))))
        if (angles := numbers(element, "euler", 3)) is not None:
            return self._euler(angles)
        if (axes := numbers(element, "xyaxes", 6)) is not None:
            x = unit(axes[:3], what)
            y = unit(axes[3:] - (axes[3:] @ x) * x, what)
            return np.stack((x, y, np.cross(x, y)), axis=1)
        if (z := numbers(element, "zaxis", 3)) is not None:
            return least_turn(unit(z, what))
        return np.eye(3)

    def _euler(self, angles: Floats) -> Floats:
        turn = np.eye(3)
        for letter, angle in zip(self.euler, angles, strict=True):
            axis = np.eye(3)["xyz".index(letter.lower())]
            step = Rotation.from_rotvec(axis * self.angle(float(angle))).as_matrix()
            turn = turn @ step if letter.islower() else step @ turn
        return turn


def rotation_of(quat: Floats, what: str) -> Floats:
    """A rotation (3, 3) of a quaternion (w, x, y, z) of any length but 0."""
    return _matrix(Rotation.from_quat(unit(quat, what), scalar_first=True))


def least_turn(z: Floats) -> Floats:
    """The smallest rotation (3, 3) that takes z to a unit vector."""
    axis = np.cross((0.0, 0.0, 1.0), z)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3) if z[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return _matrix(Rotation.from_rotvec(axis / sine * math.atan2(sine, float(z[2]))))


def _matrix(turn: Rotation) -> Floats:
    found: Floats = turn.as_matrix()
    return found


def read_rules(path: Path, root: Element) -> Rules:
    """What holds for a whole file.

    Raises:
        InputError: classes of one name, or settings that are none.
    """
    compiler = _merged(root, "compiler")
    euler = compiler.get("eulerseq", "xyz")
    if len(euler) != 3 or not set(euler) <= set(_AXES):
        raise InputError(f"{path}: eulerseq is {euler!r:.20}; expected three axes, such as xyz")
    if compiler.get("coordinate", "local") != "local":
        raise InputError(f"{path}: has global coordinates; save it from a newer MuJoCo")
    classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
    waiting = [(each, MAIN) for each in root.findall("default")]
    first = True
    while waiting:
        element, parent = waiting.pop(0)
        name = element.get("class", MAIN if parent == MAIN and first else "")
        if name != MAIN and name in classes:
            raise InputError(f"{path}: class {name!r:.40} is given twice")
        own = classes.setdefault(name, {tag: dict(a) for tag, a in classes[parent].items()})
        for child in element:
            if child.tag == "default":
                waiting.append((child, name))
            else:
                own.setdefault(child.tag, {}).update(child.attrib)
        first = bool(waiting) and waiting[0][0].get("class") in (None, MAIN)
    folder = compiler.get("meshdir", compiler.get("assetdir", ""))
    assets = {
        mesh.get("name") or Path(mesh.get("file", "")).stem: mesh
        for asset in root.findall("asset")
        for mesh in asset.findall("mesh")
    }
    return Rules(
        degrees=compiler.get("angle", "degree") == "degree",
        euler=euler,
        limited=compiler.get("autolimits", "true") == "true",
        meshes=inside(path.parent, folder) if folder else path.parent,
        classes=classes,
        assets=assets,
    )


def _merged(root: Element, tag: str) -> dict[str, str]:
    return {name: value for each in root.findall(tag) for name, value in each.attrib.items()}


def with_includes(path: Path, root: Element) -> Element:
    """The model with the content of files that it includes, from its own folder only.

    Raises:
        InputError: they lie elsewhere, are no XML, or are many.
    """
    left = [_FILES]
    return _included(path.parent, root, left)


def _included(folder: Path, element: Element, left: list[int]) -> Element:
    children: list[Element] = []
    for child in element:
        if child.tag != "include":
            children.append(_included(folder, child, left))
            continue
        left[0] -= 1
        if left[0] < 0:
            raise InputError(f"{folder}: more than {_FILES} files are included, or one by itself")
        file = inside(folder, child.get("file", ""))
        children += list(_included(folder, read_xml(file, "an included MJCF"), left))
    found = Element(element.tag, element.attrib)
    found.extend(children)
    return found
