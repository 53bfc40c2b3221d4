"""The skeleton of a BVH file as a rigged figure of sticks, so that its joints are found like any
character's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from perfcap.actor.bone_names import match_names
from perfcap.actor.template import Template
from perfcap.io.bvh_read import BvhMotion, Floats

_THICK = 0.03  # of a stick, in its own lengths
_SHORTEST = 1e-6  # of the figure's size: bones below it get no stick
_ROUND = 3  # corners of a stick
_TELLING = ("hip", "knee", "ankle", "shoulder")
_STRAIGHT = 0.8  # cosine to the shank from which what follows is no foot
_FOOT_AHEAD, _FOOT_DOWN = 0.4, 0.12  # of the shank, where there is no foot


def stick_figure(motion: BvhMotion, places: Floats, name: str) -> Template:
    """A mesh of one stick a bone, in the file's units and axes, resting at some places.

    Args:
        motion: whose joints.
        places: of the joints, (J, 3).
        name: of the figure.
    """
    size = max(float(np.ptp(places, axis=0).max()), 1e-9)
    rest = np.tile(np.eye(4), (len(places), 1, 1))
    rest[:, :3, 3] = places
    vertices: list[Floats] = []
    faces: list[tuple[int, int, int]] = []
    bones: list[int] = []
    for joint, start, end in _sticks(motion, places):
        if np.linalg.norm(end - start) < _SHORTEST * size:
            continue
        first = len(vertices)
        vertices += [start, *_ring(start, end), end]
        around = [(first + 1 + k, first + 1 + (k + 1) % _ROUND) for k in range(_ROUND)]
        faces += [(first, b, a) for a, b in around]
        faces += [(first + 1 + _ROUND, a, b) for a, b in around]
        bones += [joint] * (_ROUND + 2)
    return Template(
        vertices=np.array(vertices).reshape(-1, 3),
        faces=np.array(faces, dtype=np.int64).reshape(-1, 3),
        bone_names=_unique(motion.names),
        bone_parents=np.asarray(motion.parents),
        bone_rest=rest,
        weight_bones=np.array(bones, dtype=np.int64)[:, None],
        weights=np.ones((len(bones), 1)),
        name=name,
    )


def with_feet(motion: BvhMotion, places: Floats) -> BvhMotion:
    """The motion with feet that point ahead, where its own end at the ankles.

    A skeleton without feet does not tell where it faces, but its names tell left from right. What
    continues the shank is no foot: programs write it where the format asks for an end.

    Args:
        motion: whose joints.
        places: of the joints at rest, (J, 3).
    """
    joints = match_names(motion.names, np.ones(len(motion.names))).joints
    if not {f"{s}_{n}" for s in "lr" for n in _TELLING} | {"neck"} <= joints.keys():
        return motion
    at = {name: places[bone] for name, bone in joints.items()}
    up = at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"])
    left = at["l_hip"] - at["r_hip"] + at["l_shoulder"] - at["r_shoulder"]
    ahead = np.cross(left, up)
    size = float(np.linalg.norm(ahead))
    if not size > 0:
        return motion
    ends = np.full(places.shape, np.nan) if motion.ends is None else motion.ends.copy()
    for side in "lr":
        ankle = joints[f"{side}_ankle"]
        shank = places[ankle] - at[f"{side}_knee"]
        if np.any(motion.parents == ankle) or not _continues(shank, ends[ankle]):
            continue
        length = float(np.linalg.norm(shank))
        ends[ankle] = length * (_FOOT_AHEAD * ahead / size + _FOOT_DOWN * shank / length)
    return replace(motion, ends=ends)


def _continues(bone: Floats, end: Floats) -> bool:
    """Whether what ends a bone goes straight on, or is not there."""
    if not np.isfinite(end).all():
        return True
    sizes = float(np.linalg.norm(bone) * np.linalg.norm(end))
    return not sizes > 0 or float(bone @ end) > _STRAIGHT * sizes


def _sticks(motion: BvhMotion, places: Floats) -> Iterator[tuple[int, Floats, Floats]]:
    """Joint that moves a stick, and its ends."""
    for joint, parent in enumerate(motion.parents.tolist()):
        if parent >= 0:
            yield parent, places[parent], places[joint]
    if motion.ends is not None:
        for joint in np.flatnonzero(np.isfinite(motion.ends).all(1)).tolist():
            yield joint, places[joint], places[joint] + motion.ends[joint]


def _ring(start: Floats, end: Floats) -> list[Floats]:
    """Corners around the first quarter of a stick."""
    along = end - start
    length = float(np.linalg.norm(along))
    other = np.eye(3)[int(np.abs(along).argmin())]
    side = np.cross(along, other)
    side *= _THICK * length / max(float(np.linalg.norm(side)), 1e-300)
    across = np.cross(along, side) / length
    turns = 2 * np.pi * np.arange(_ROUND) / _ROUND
    return [start + 0.25 * along + np.cos(t) * side + np.sin(t) * across for t in turns]


def _unique(names: tuple[str, ...]) -> tuple[str, ...]:
    found: dict[str, None] = {}
    for number, name in enumerate(names):
        found[name if name and name not in found else f"{name}_{number}"] = None
    return tuple(found)
