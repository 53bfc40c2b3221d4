"""Whether corners of the background move as the poses and the lens of a camera say.

A corner that stands still somewhere along its ray of one frame is seen, in another, on a piece of a
line: from where the ray's direction is seen to where a point near the camera would be (the epipolar
line; Hartley and Zisserman 2004, chapter 9). Of a camera that only turns this piece is a point, so
that nothing here depends on how far a camera moves between two frames.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.matchmove.corner_tracks import Sightings
from perfcap.setting_checks import Settings

Array = NDArray[np.float64]

_NEAREST = 0.3  # m from a camera, nearer than which nothing stands
_FRONT = 0.05  # m before a camera, behind which nothing is seen
_SPREAD = 0.08  # of the longer side, deviation of corners across and down; a strip tells little
_WIDE = 1000.0  # px, of a picture in which the search's own numbers are right
_ROUNDS = 5  # of what rows are off by
_SURE, _TRIALS = 0.999, 500  # of the search for the camera that explains corners best


@dataclass(frozen=True)
class GivenWaySettings(Settings):
    """Which frames are compared, and what counts.

    Attributes:
        longest: s between two frames that are compared.
        shortest: the same, where corners are soon out of the picture.
        every: s between pairs of frames.
        least: corners that both frames of a pair show.
        off: of the longer side of the image, by which half of the corners are off at least.
        explained: of the longer side, within which some camera has three quarters of them.
    """

    longest: float = 1.0
    shortest: float = 0.2
    every: float = 0.25
    least: int = 24
    off: float = 0.005
    explained: float = 0.002


@dataclass(frozen=True)
class SeenWay:
    """The way of a camera, and corners that are seen along it.

    Attributes:
        sightings: N, of some of the frames.
        plane: where they are on the plane z = 1 of the camera, undistorted, (N, 2).
        rotation: world to camera, (F, 3, 3).
        translation: the same, (F, 3), m.
        focal: length by the longer side of the image, (F,).
        rate: frames a second.
    """

    sightings: Sightings
    plane: Array
    rotation: Array
    translation: Array
    focal: Array
    rate: float


@dataclass(frozen=True)
class Pair:
    """Corners that two frames show.

    Attributes:
        first: of the frames.
        second: the other, later.
        here: corners on the plane z = 1 in the first, (N, 2).
        there: the same in the second.
    """

    first: int
    second: int
    here: Array
    there: Array


@dataclass(frozen=True)
class Compared:
    """How far the corners of a pair of frames are from where a way has them.

    Attributes:
        pair: the frames.
        off: in the median, of the longer side of the image.
        wrong: whether that is too much, and some camera explains these corners.
    """

    pair: Pair
    off: float
    wrong: bool


def compare_way(way: SeenWay, settings: GivenWaySettings | None = None) -> list[Compared]:
    """How well corners agree with the way of a camera, in pairs of frames.

    Args:
        way: of F frames, with the corners that are seen.
        settings: of the comparison.
    """
    settings = settings or GivenWaySettings()
    found = []
    for pair in _pairs(way, settings):
        off = off_way(way, pair)
        wrong = off > settings.off and _explained(way, pair, settings.explained)
        found.append(Compared(pair, off, wrong))
    return found


def off_way(way: SeenWay, pair: Pair, shift: int = 0) -> float:
    """How far corners are from where the way has them in the median, of the longer side.

    Args:
        way: of F frames.
        pair: two of them.
        shift: by which later poses are taken.
    """
    first, second = pair.first + shift, pair.second + shift
    turn = way.rotation[second] @ way.rotation[first].T
    along = way.translation[second] - turn @ way.translation[first]
    errors = np.maximum(
        way.focal[second] * _from_lines(pair.here, pair.there, turn, along),
        way.focal[first] * _from_lines(pair.there, pair.here, turn.T, -turn.T @ along),
    )
    return float(np.median(errors))


def _pairs(way: SeenWay, settings: GivenWaySettings) -> Iterator[Pair]:
    """Pairs that are as far apart as they share enough corners, evenly spread."""
    seen, rate = way.sightings, way.rate
    tracked, starts = np.unique(seen.frame, return_index=True)  # rows come frame by frame
    stops = [*starts[1:].tolist(), len(seen)]
    rows = dict(zip(tracked.tolist(), map(slice, starts.tolist(), stops), strict=False))
    begin = -math.inf
    for first in tracked.tolist():
        if first < begin:
            continue
        begin = first + round(settings.every * rate)
        nearest, farthest = first + settings.shortest * rate, first + settings.longest * rate
        for second in tracked[(tracked >= nearest) & (tracked <= farthest)][::-1].tolist():
            points = seen.point[rows[first]], seen.point[rows[second]]
            _, here, there = np.intersect1d(*points, assume_unique=True, return_indices=True)
            planes = way.plane[rows[first]][here], way.plane[rows[second]][there]
            if len(here) >= settings.least and min(map(_spread, planes)) * way.focal[0] > _SPREAD:
                yield Pair(first, second, *planes)
                break


def _spread(plane: Array) -> float:
    return float(plane.std(0).min())


def _from_lines(here: Array, there: Array, turn: Array, shift: Array) -> Array:
    """Distances of points from the pieces of lines of others, on the plane z = 1, (N,).

    Lines of an image are read one after the other: what a camera that shakes does meanwhile shifts
    corners in proportion to their row, which says nothing about its poses and is taken out.
    """
    rays = np.column_stack((here, np.ones(len(here))))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    far = rays @ turn.T
    nearness = np.full(len(far), 1 / _NEAREST)
    if shift[2] < 0:
        nearness = np.clip((_FRONT - far[:, 2]) / shift[2], 0, nearness)
    near = far + nearness[:, None] * shift
    ends = [each[:, :2] / np.maximum(each[:, 2:], _FRONT) for each in (far, near)]
    along = ends[1] - ends[0]
    size = np.maximum(np.square(along).sum(1), 1e-18)
    row = there[:, 1:] - np.median(there[:, 1])
    skew = np.zeros(2)
    for _ in range(_ROUNDS):
        seen = there - row * skew
        share = np.clip(((seen - ends[0]) * along).sum(1) / size, 0, 1)
        apart = seen - ends[0] - share[:, None] * along
        distance = np.linalg.norm(apart, axis=1)
        wide = max(1e-9, 2 * float(np.median(distance)))
        weight = 1 / np.square(1 + np.square(distance[:, None] / wide))
        middle = (weight * apart).sum(0) / weight.sum()
        skew = skew + (weight * row * (apart - middle)).sum(0) / (weight * row * row).sum()
    return np.asarray(distance)


def _explained(way: SeenWay, pair: Pair, within: float) -> bool:
    """Whether some camera has three quarters of the corners within so much, whatever its lens."""
    scale = _WIDE * way.focal[pair.first]
    limit = _WIDE * within
    here, there = scale * pair.here, scale * pair.there
    matrix, _ = cv2.findFundamentalMat(here, there, cv2.FM_RANSAC, limit, _SURE, _TRIALS)
    if matrix is None or matrix.shape != (3, 3):
        return False
    one, other = (np.column_stack((each, np.ones(len(each)))) for each in (here, there))
    line, back = one @ matrix.T, other @ matrix
    size = np.sqrt(np.minimum(np.square(line[:, :2]).sum(1), np.square(back[:, :2]).sum(1)))
    errors = np.abs((other * line).sum(1)) / np.maximum(size, 1e-12)
    return bool(np.quantile(errors, 0.75) < limit)
