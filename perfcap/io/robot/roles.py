"""Which bodies of a robot are the joints of a person: by names, and by what hangs on what."""

from __future__ import annotations

import re
from collections.abc import Mapping

from perfcap.actor.anatomy import JOINTS
from perfcap.errors import InputError
from perfcap.io.robot.description import Robot

_KNEE = "knee|shin|tibia|calf|lower_?leg"
_ELBOW = "elbow|radius|ulna|fore_?arm|lower_?arm"
_FOOT, _TOES = "foot|ankle", "toe"
_WRIST, _FINGERS = "wrist|hand", "finger|thumb"
_SIDES = {"l": "left", "r": "right"}


def person_bodies(robot: Robot, given: Mapping[str, str]) -> dict[str, int]:
    """The body of each of the sixteen joints of a person.

    Knees and elbows are known by their names; thighs and upper arms hold them, the pelvis and the
    chest hold both of them, feet and hands hang on them. Several joints of a person may be on one
    body, such as chest and neck.

    Args:
        robot: whose bodies.
        given: names of bodies by joint, from a user.

    Raises:
        InputError: some are not found, or a name is none of a body.
    """
    found = _given(robot, given)
    for side in "lr":
        for end, words in (("knee", _KNEE), ("elbow", _ELBOW)):
            _add(found, f"{side}_{end}", _first(robot, words, side, range(len(robot.bodies))))
        for end, start in (("hip", "knee"), ("shoulder", "elbow")):
            if f"{side}_{start}" in found:
                _add(found, f"{side}_{end}", _holder(robot, found[f"{side}_{start}"]))
        if f"{side}_knee" in found:
            below = robot.below(found[f"{side}_knee"])[1:]
            _add(found, f"{side}_ankle", _last_hinged(robot, _FOOT, _TOES, below))
        if f"{side}_elbow" in found:
            below = robot.below(found[f"{side}_elbow"])[1:]
            _add(found, f"{side}_wrist", _first(robot, _WRIST, "", below, _FINGERS))
    if {"l_knee", "r_knee", "l_elbow", "r_elbow"} <= found.keys():
        _add(found, "pelvis", _common(robot, found["l_knee"], found["r_knee"]))
        _add(found, "spine", _common(robot, found["l_elbow"], found["r_elbow"]))
        head = _last_hinged(robot, "head|neck", "", range(len(robot.bodies)))
        _add(found, "head", found["spine"] if head is None else head)
        _add(found, "neck", found["spine"])
    missing = [joint for joint in JOINTS if joint not in found]
    if missing:
        names = ", ".join(body.name for body in robot.bodies)
        raise InputError(
            f"{robot.name}: finds no body for {', '.join(missing)} among {names[:300]}; name them "
            'in a file given as --mapping, such as l_knee = "left_shin"'
        )
    return found


def _given(robot: Robot, given: Mapping[str, str]) -> dict[str, int]:
    names = [body.name for body in robot.bodies]
    unknown = sorted(set(given.values()) - set(names))
    if unknown:
        raise InputError(
            f"--mapping: {robot.name} has no body {', '.join(unknown)[:80]}; it has "
            f"{', '.join(names)[:300]}"
        )
    return {joint: names.index(name) for joint, name in given.items() if joint in JOINTS}


def _add(found: dict[str, int], joint: str, body: int | None) -> None:
    if body is not None:
        found.setdefault(joint, body)


def _text(robot: Robot, index: int) -> str:
    """Names of a body and its hinges, in small letters."""
    body = robot.bodies[index]
    return " ".join((body.name, *(hinge.name for hinge in body.hinges))).lower()


def _first(
    robot: Robot, words: str, side: str, among: range | list[int], but: str = ""
) -> int | None:
    """The first body, from the root, whose names say so; one with hinges where there is one."""
    named = [
        index
        for index in among
        if re.search(words, _text(robot, index))
        and not (but and re.search(but, _text(robot, index)))
        and (not side or _on_side(robot.bodies[index].name, words, side))
    ]
    hinged = [index for index in named if robot.bodies[index].hinges]
    return next(iter(hinged or named), None)


def _on_side(name: str, words: str, side: str) -> bool:
    """Whether a name says left or right: L_KNEE, left_knee, kneeL, ltibia, KneeLeft."""
    small, word = name.lower(), _SIDES[side]
    if re.search("left|right", small):
        return word in small
    apart = re.search(rf"(^|[^a-z]){side}([^a-z]|$)", small)
    joined = re.search(rf"^{side}_?({words})|({words})_?{side}$", small)
    return bool(apart or joined)


def _holder(robot: Robot, body: int) -> int | None:
    """The next body above that turns; else the one above."""
    above = robot.above(body)[1:]
    return next((b for b in above if robot.bodies[b].hinges), above[0] if above else None)


def _last_hinged(robot: Robot, words: str, but: str, among: range | list[int]) -> int | None:
    """The last body with hinges whose names say so, or else the first one without."""
    named = [
        index
        for index in among
        if re.search(words, robot.bodies[index].name.lower())
        and not (but and re.search(but, robot.bodies[index].name.lower()))
    ]
    hinged = [index for index in named if robot.bodies[index].hinges]
    return hinged[-1] if hinged else next(iter(named), None)


def _common(robot: Robot, one: int, other: int) -> int:
    """The last body that both hang on."""
    above = set(robot.above(one))
    return next((body for body in robot.above(other) if body in above), 0)
