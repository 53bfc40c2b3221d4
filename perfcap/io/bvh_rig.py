"""The skeleton of a BVH file as a rigged figure of sticks, so that its joints are found like any
character's.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from perfcap.actor.template import Template
from perfcap.io.bvh_motion import BvhMotion, Floats

_THICK = 0.03  # of a stick, in its own lengths
_SHORTEST = 1e-6  # of the figure's size: bones below it get no stick
_ROUND = 3  # corners of a stick


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
