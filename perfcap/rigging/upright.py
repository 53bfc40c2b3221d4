"""Which way up a mesh is, where it looks, and in which unit it is."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from perfcap.errors import InputError

Floats = NDArray[np.float64]

UNITS = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}
STATURE = (1.2, 2.3)  # metres of people in shoes and hats; the unit must bring a mesh in between
_USUAL = 1.72  # metres, where no unit does
_SAMPLES = 1200
_NEARLY, _MOST = 1.15, 3  # directions that fit nearly as well as the best, and at most so many
_ASKEW = 1.1
_SAME = 2.6  # trace of the rotation between directions that are one: less than 37 degrees


@dataclass(frozen=True, eq=False)
class Upright:
    """A similarity that makes a mesh stand: ``x -> scale * rotation @ x + translation``.

    Attributes:
        rotation: (3, 3), to y up, facing +z.
        scale: to metres.
        translation: (3,) metres; the lowest point comes to y = 0, the middle above the origin.
        unit: name of the unit the mesh was taken to be in.
        score: root mean square distance to a person, statures.
    """

    rotation: Floats
    scale: float
    translation: Floats
    unit: str
    score: float

    def apply(self, vertices: Floats) -> Floats:
        """Vertices (V, 3) upright, metres."""
        return np.asarray(self.scale * vertices @ self.rotation.T + self.translation)


def stand_up(samples: Floats, people: list[Floats], height: float | None = None) -> list[Upright]:
    """Similarities under which points look like a person, the likeliest first; at least one.

    Tries the 24 rotations that take axes to axes, as files differ by, and the same about the
    principal axes of the points, for scans that lie askew. Front and back look alike from afar:
    what fits nearly as well as the best is returned too, to be told apart by a closer fit.

    Args:
        samples: points spread over the mesh, (N, 3), any unit.
        people: points of upright people, y up, facing +z, in different poses, (M, 3) each.
        height: of the person, metres; the unit is guessed without it.

    Raises:
        InputError: the points have no extent.
    """
    if not np.ptp(samples, axis=0).max() > 0:
        raise InputError("mesh has no extent; give the mesh of a person")
    points = samples[:: max(1, len(samples) // _SAMPLES)]
    known = [_Person(person) for person in people]
    scored = [
        (handicap * min(person.distance(points @ rotation.T) for person in known), rotation)
        for handicap, rotation in _rotations(points)
    ]
    scored.sort(key=lambda entry: entry[0])
    kept: list[Upright] = []
    for score, rotation in scored:
        apart = all(np.trace(rotation @ other.rotation.T) < _SAME for other in kept)
        if len(kept) < _MOST and apart and (not kept or score < _NEARLY * kept[0].score):
            kept.append(_upright(samples, rotation, score, height))
    return kept


def _upright(samples: Floats, rotation: Floats, score: float, height: float | None) -> Upright:
    turned = samples @ rotation.T
    scale, unit = _scale(float(np.ptp(turned[:, 1])), height)
    shift = -scale * np.median(turned, axis=0)
    shift[1] = -scale * turned[:, 1].min()
    return Upright(rotation, scale, shift, unit, score)


class _Person:
    """A person of height one whose outline boxes start at zero."""

    def __init__(self, points: Floats) -> None:
        self.points = _unit(points)
        self.tree = cKDTree(self.points)

    def distance(self, others: Floats) -> float:
        """Root mean square distance both ways, after the same normalisation."""
        points = _unit(others)
        there = np.minimum(self.tree.query(points)[0], 0.2)
        back = np.minimum(cKDTree(points).query(self.points)[0], 0.2)
        return float(np.sqrt(0.5 * ((there**2).mean() + (back**2).mean())))


def _unit(points: Floats) -> Floats:
    """Height one, soles at zero, middle at the origin."""
    points = points / max(float(np.ptp(points[:, 1])), 1e-12)
    shift = np.median(points, axis=0)
    shift[1] = points[:, 1].min()
    return np.asarray(points - shift)


def _rotations(points: Floats) -> Iterator[tuple[float, Floats]]:
    """Rotations with a factor on their score: exact ones win over estimated ones."""
    axes = np.linalg.svd(points - points.mean(0), full_matrices=False)[2]
    axes[2] *= np.sign(np.linalg.det(axes))
    for rotation in _cube():
        yield 1.0, rotation
        yield _ASKEW, rotation @ axes


def _cube() -> Iterator[Floats]:
    """The 24 rotations of a cube, the identity first."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                yield matrix


def _scale(extent: float, height: float | None) -> tuple[float, str]:
    if height is not None:
        return height / extent, "given height"
    for name, factor in UNITS.items():
        if STATURE[0] <= extent * factor <= STATURE[1]:
            return factor, name
    return _USUAL / extent, "unknown"
