"""Fingers that rest: those of rigs are modelled straight, those of people are bent.

Captured joints end at the wrists, so bones of fingers rest on them in one pose.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template

Floats = NDArray[np.float64]

# Flexion of the knuckles, middle and last joints of four fingers at rest, degrees. The middle ones
# bend most (Lee and Jung 2014, Int. J. Occup. Saf. Ergon. 20(1)); knuckles bend less than where a
# hand is splinted (45, 30, 20), because rigs are skinned straight.
REST = (20.0, 30.0, 15.0)
_FINGERS, _PHALANGES = 5, 3
_THUMB = 0.8  # of the way to the other fingers, within which a thumb begins
_MOVED = 1e-6  # sum of weights of a bone that moves anything


@dataclass(frozen=True)
class _Hand:
    """Four fingers from the index to the little one, three bones each, (4, 3), and the palm's
    normal, out of the palm, (3,).
    """

    fingers: NDArray[np.int64]
    palm: Floats


def resting_fingers(template: Template, joints: Mapping[str, int]) -> Floats | None:
    """Rest-to-rest transforms of the bones that bend fingers, (B, 4, 4).

    A joint that is bent by more already stays; so do thumbs, and hands without five fingers of
    three bones.

    Args:
        template: the rigged mesh; metres, y up.
        joints: bone by joint.

    Returns:
        None where nothing bends.
    """
    moved = np.zeros(len(template.bone_names))
    np.add.at(moved, template.weight_bones, template.weights)
    turns: dict[int, Floats] = {}
    for side in "lr":
        if f"{side}_wrist" in joints:
            hand = _hand(template, joints[f"{side}_wrist"], moved > _MOVED, side)
            turns |= {} if hand is None else _turns(template, hand)
    if not turns:
        return None
    offsets = np.tile(np.eye(4), (len(template.bone_names), 1, 1))
    for bone, parent in enumerate(template.bone_parents.tolist()):
        if parent >= 0:
            offsets[bone] = offsets[parent]
        if bone in turns:
            offsets[bone] = offsets[bone] @ turns[bone]
    return offsets


def _hand(template: Template, wrist: int, moves: NDArray[np.bool_], side: str) -> _Hand | None:
    parents, places = template.bone_parents, template.bone_rest[:, :3, 3]
    chains = _chains(parents.tolist(), wrist, moves)
    if len(chains) != _FINGERS:
        return None
    away = np.linalg.norm(places[[chain[0] for chain in chains]] - places[wrist], axis=1)
    thumb = int(away.argmin())
    others = [number for number in range(_FINGERS) if number != thumb]
    if away[thumb] > _THUMB * np.median(away[others]):
        return None
    knuckles = places[[chains[number][0] for number in others]]
    beside = np.linalg.norm(knuckles - places[chains[thumb][0]], axis=1)
    order = np.argsort(beside)  # the index finger is nearest to the thumb
    fingers = np.array([chains[others[number]] for number in order])
    along = knuckles.mean(0) - places[wrist]
    palm = np.cross(knuckles[order[-1]] - knuckles[order[0]], along)
    palm *= (1.0 if side == "l" else -1.0) / max(float(np.linalg.norm(palm)), 1e-12)
    return _Hand(fingers, palm)


def _chains(parents: list[int], wrist: int, moves: NDArray[np.bool_]) -> list[list[int]]:
    """The last three bones of every finger below a wrist, in the order of its bones."""
    below = {wrist}
    for bone, parent in enumerate(parents):
        if parent in below and moves[bone]:
            below.add(bone)
    held = {parents[bone] for bone in below - {wrist}}
    chains = []
    for tip in sorted(below - held - {wrist}):
        chain = [tip]
        while len(chain) < _PHALANGES and parents[chain[0]] != wrist:
            chain.insert(0, parents[chain[0]])
        if len(chain) == _PHALANGES:
            chains.append(chain)
    first = [chain[0] for chain in chains]
    return chains if len(set(first)) == len(first) else []


def _turns(template: Template, hand: _Hand) -> dict[int, Floats]:
    """What each phalanx still turns about its own head, (4, 4), in rest coordinates."""
    places, found = template.bone_rest[:, :3, 3], {}
    for finger in hand.fingers:
        before = int(template.bone_parents[finger[0]])
        ends = [places[before], *places[finger], _tip(template, int(finger[-1]))]
        ways = [b - a for a, b in pairwise(ends)]
        axis = np.cross(ways[1], hand.palm)
        axis /= max(float(np.linalg.norm(axis)), 1e-12)
        for bone, one, other, rest in zip(finger.tolist(), ways[:-1], ways[1:], REST, strict=True):
            bent = math.atan2(float(np.cross(one, other) @ axis), float(one @ other))
            missing = min(max(math.radians(rest) - bent, 0.0), math.radians(rest))
            if missing > 0:
                found[bone] = _about(places[bone], axis, missing)
    return found


def _tip(template: Template, bone: int) -> Floats:
    """Where the last bone of a finger leads: the middle of what it moves most."""
    mine = template.weight_bones[:, 0] == bone
    middle: Floats = (
        template.vertices[mine].mean(0) if mine.any() else template.bone_rest[bone, :3, 3]
    )
    return middle


def _about(place: Floats, axis: Floats, angle: float) -> Floats:
    """The rotation about an axis through a place, (4, 4)."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.eye(4)
    turn[:3, :3] += math.sin(angle) * skew + (1 - math.cos(angle)) * skew @ skew
    turn[:3, 3] = place - turn[:3, :3] @ place
    return turn
