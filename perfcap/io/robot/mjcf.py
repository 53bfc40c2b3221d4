"""Read MuJoCo's MJCF: bodies with hinges, one of them free or fixed in the world.

The models of MuJoCo have more than what moves; actuators, contacts and the like are not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from perfcap.errors import InputError
from perfcap.io.robot import shapes
from perfcap.io.robot.description import Body, Floats, Robot, RobotHinge, coupled_note
from perfcap.io.robot.elements import Element, inside, numbers, unit
from perfcap.io.robot.mjcf_defaults import (
    MAIN,
    Rules,
    least_turn,
    read_rules,
    rotation_of,
    with_includes,
)

_FLAT = ("plane", "hfield", "sdf")
_COLLIDES = ("contype", "conaffinity")
_MADE = ("attach", "replicate")


def read_mjcf_robot(path: Path, root: Element) -> Robot:
    """The robot of a file, whose outermost element is read.

    Raises:
        InputError: it is no MJCF of one robot on hinges, or names files outside of its folder.
    """
    root = with_includes(path, root)
    rules = read_rules(path, root)
    tops = [top for w in root.findall("worldbody") for top in _parts(path, w, "body", MAIN, rules)]
    tops = [top for top in tops if _moves(top.element)] or tops
    if len(tops) != 1:
        raise InputError(f"{path}: has {len(tops)} bodies with joints in its world; expected one")
    bodies: list[Body] = []
    left_out: set[str] = set()
    waiting = [(tops[0], -1)]
    while waiting:
        part, parent = waiting.pop()
        element, inherited = part.element, part.element.get("childclass", part.inherited)
        hinges = tuple(_hinges(path, element, inherited, rules, parent < 0))
        found = tuple(_surfaces(path, element, inherited, rules, left_out))
        index, pose = len(bodies), part.pose @ rules.pose(element)
        bodies.append(Body(element.get("name", ""), parent, pose, hinges, found))
        below = list(_parts(path, element, "body", inherited, rules))
        waiting += [(each, index) for each in reversed(below)]
    notes = []
    if left_out:
        kinds = ", ".join(sorted(left_out))
        notes.append(f"{path}: its shapes of {kinds} are not read; the robot is drawn without them")
    coupled = [j.get("joint1", "") for e in root.findall("equality") for j in e.findall("joint")]
    notes += coupled_note(path, coupled, "<equality>")
    return Robot(root.get("model") or path.stem, tuple(bodies), tuple(notes)).checked()


def _moves(element: Element) -> bool:
    """Whether a body of the world, or what hangs on it, has places in ``qpos``."""
    return any(each.tag in ("joint", "freejoint") for each in element.iter())


@dataclass(frozen=True)
class _Part:
    """An element of a body, what frames around it do to it (4, 4), and the class it inherits."""

    element: Element
    pose: Floats
    inherited: str


def _parts(path: Path, element: Element, tag: str, inherited: str, rules: Rules) -> Iterator[_Part]:
    """Children of a name, in frames or not."""
    for child in element:
        if child.tag == tag:
            yield _Part(child, np.eye(4), inherited)
        elif child.tag == "frame":
            pose, own = rules.pose(child), child.get("childclass", inherited)
            for part in _parts(path, child, tag, own, rules):
                yield replace(part, pose=pose @ part.pose)
        elif child.tag in _MADE:
            raise InputError(
                f"{path}: has <{child.tag}>, which makes bodies that are not in the file; save the "
                "compiled model with MuJoCo (mj_saveLastXML) and give that"
            )


def _hinges(
    path: Path, body: Element, inherited: str, rules: Rules, root: bool
) -> Iterator[RobotHinge]:
    for number, part in enumerate(_parts(path, body, "joint", inherited, rules)):
        joint = rules.with_defaults(part.element, part.inherited)
        name = joint.get("name") or f"{body.get('name', 'body')}_{number}"
        kind = joint.get("type", "hinge")
        if kind == "free" and root:
            continue
        if kind != "hinge" or root:
            expected = "a free joint" if root else "hinges; write a ball joint as three of them"
            raise InputError(f"{path}: joint {name!r:.40} is {kind!r:.20}, expected {expected}")
        axis = numbers(joint, "axis", 3, "0 0 1")
        anchor, reference = numbers(joint, "pos", 3, "0 0 0"), numbers(joint, "ref", 1, "0")
        assert axis is not None and anchor is not None and reference is not None
        rest = rules.angle(float(reference[0]))
        anchor = part.pose[:3, :3] @ anchor + part.pose[:3, 3]
        axis = part.pose[:3, :3] @ axis
        lower, upper = _limits(path, joint, name, rules)
        yield RobotHinge(name, anchor, unit(axis, f"{path}: {name}"), lower, upper, rest)


def _limits(path: Path, joint: Element, name: str, rules: Rules) -> tuple[float, float]:
    bounds = numbers(joint, "range", 2)
    limited = joint.get("limited", "auto")
    if bounds is None or limited == "false" or (limited == "auto" and not rules.limited):
        return -math.inf, math.inf
    lower, upper = (rules.angle(float(bound)) for bound in bounds)
    if not lower < upper:
        raise InputError(
            f"{path}: joint {name!r:.40} has the range {bounds[0]:g} {bounds[1]:g}; expected the "
            "lower end below the upper"
        )
    return lower, upper


def _surfaces(
    path: Path, body: Element, inherited: str, rules: Rules, left_out: set[str]
) -> Iterator[shapes.Surface]:
    """What collides, or else what is seen."""
    parts = _parts(path, body, "geom", inherited, rules)
    geoms = [(rules.with_defaults(each.element, each.inherited), each.pose) for each in parts]
    hard = [pair for pair in geoms if any(pair[0].get(kind, "1") != "0" for kind in _COLLIDES)]
    for geom, frame in hard or geoms:
        kind = geom.get("type", "sphere")
        surface = None
        pose = rules.pose(geom)
        if geom.get("mesh") is not None:
            surface = _mesh(geom, rules, left_out)
        elif kind not in _FLAT:
            surface, pose = _primitive(geom, kind, pose)
        if surface is not None:
            yield shapes.moved(surface, frame @ pose)


def _primitive(geom: Element, kind: str, pose: Floats) -> tuple[shapes.Surface | None, Floats]:
    size = [float(word) for word in _sizes(geom)]
    ends = numbers(geom, "fromto", 6)
    if ends is not None:
        start, end = ends[:3], ends[3:]
        pose[:3, :3] = least_turn(unit(end - start, "fromto"))
        pose[:3, 3] = 0.5 * (start + end)
        half = 0.5 * float(np.linalg.norm(end - start))
        size = [size[0], half] if kind in ("capsule", "cylinder") else [size[0], size[0], half]
    needed = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}.get(kind)
    if needed is None:
        return None, pose
    if len(size) < needed:
        raise InputError(
            f"<geom name={geom.get('name', '')!r:.40}>: a {kind} has {len(size)} sizes, expected "
            f"{needed}"
        )
    if kind == "sphere":
        return shapes.sphere(size[0]), pose
    if kind in ("capsule", "cylinder"):
        make = shapes.capsule if kind == "capsule" else shapes.cylinder
        return make(size[0], size[1]), pose
    make_three = shapes.box if kind == "box" else shapes.ellipsoid
    return make_three(np.array(size[:3])), pose


def _sizes(geom: Element) -> Floats:
    words = geom.get("size", "").split()
    found = numbers(geom, "size", len(words), "") if 0 < len(words) <= 3 else None
    if found is None or not (found >= 0).all():
        raise InputError(
            f"<geom name={geom.get('name', '')!r:.40}>: size is {geom.get('size')!r:.40}; "
            "expected one to three numbers above 0"
        )
    return found


def _mesh(geom: Element, rules: Rules, left_out: set[str]) -> shapes.Surface | None:
    asset = rules.assets.get(geom.get("mesh", ""))
    if asset is None or asset.get("file") is None:
        left_out.add("a mesh without a file")
        return None
    asset = rules.with_defaults(asset, MAIN)
    path = inside(rules.meshes, asset.get("file", ""))
    if path.suffix.lower() not in shapes.READ:
        left_out.add(path.suffix.lower() or "no format")
    surface = shapes.mesh(path, np.ones(3))
    if surface is None:
        return None
    # as MuJoCo does it: the file's own axes are taken away, then what is left is scaled
    place, turn = numbers(asset, "refpos", 3, "0 0 0"), numbers(asset, "refquat", 4, "1 0 0 0")
    scale = numbers(asset, "scale", 3, "1 1 1")
    assert place is not None and turn is not None and scale is not None
    turned = rotation_of(turn, f"{path}: refquat")
    vertices, faces = surface
    return (vertices - place) @ turned * scale, faces
