"""The way of a camera from corners of what it films: turned only, or moved as well."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from perfcap.matchmove._arguments import require_sightings
from perfcap.matchmove.bundle import Adjusted, Bundle, Prior, Problem, cross_matrix, pixel_slope
from perfcap.matchmove.corner_tracks import Sightings
from perfcap.setting_checks import Settings

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

_FEWEST = 3  # key frames that see a point
_FARTHEST = 0.02  # 1/m, nearness of points that are farther than a way can tell
_LENS = 0.03  # deviation of a log focal length by errors that sightings do not tell
_ALIKE = 3.0  # sightings of a corner, one after the other, whose errors are as good as one
_ROUNDS = 20  # of a turn between two frames, and of the frames between key frames
_ASTRAY, _SELDOM = 4.0, 0.1  # deviations off, and share of a point's sightings that may be so
_WIDE, _NARROWS = 30.0, 0.6  # px, of the kernel of a frame at first; and each round's share of it
_STEADY = 0.02, 0.03  # rad and m, deviations of a frame from the way between its key frames


@dataclass(frozen=True)
class WaySettings(Settings):
    """How a camera's way is found.

    Attributes:
        rate: key frames a second; frames between them follow.
        lens: deviation of the log focal length about the assumed one.
        speed: deviation of the camera's speed, m/s.
        far: m, distance of what is level with the camera.
        height: m, of the camera above the ground that is seen below it.
        nearness: deviation of inverse distances about these two, 1/m.
        tolerance: px of the shrunk image, within which sightings agree.
        least: points that two neighbouring key frames both see.
        explained: share of the sightings that must agree.
    """

    rate: float = 10.0
    lens: float = 0.35
    speed: float = 0.7
    far: float = 6.7
    height: float = 1.5
    nearness: float = 0.1
    tolerance: float = 1.5
    least: int = 12
    explained: float = 0.5


@dataclass(frozen=True)
class CameraWay:
    """Cameras of F frames, the first of which is the world.

    Attributes:
        rotation: world to camera, (F, 3, 3).
        translation: the same, (F, 3); all of it may be too long or too short by one factor.
        factor: focal length by the assumed one.
        deviation: of its log.
        moves: whether it does more than turn.
        explained: share of the sightings that agree.
        points: places of corners, (P, 3), of the same length; none of a camera that only turns.
    """

    rotation: Array
    translation: Array
    factor: float
    deviation: float
    moves: bool
    explained: float
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))


def find_way(
    sightings: Sightings,
    frames: int,
    lens: tuple[float, float, float],
    rate: float,
    settings: WaySettings | None = None,
    guessed: bool = True,
) -> CameraWay | None:
    """The way that explains how corners move; None where too few are seen, or agree, in a frame.

    A camera that only turns is believed unless one that moves explains clearly more, by the
    Bayesian information criterion (Schwarz 1978): what moves has a place for each frame and a
    distance for each point.

    Args:
        sightings: of corners that stand still, and of some that do not.
        frames: F.
        lens: focal length and principal point x, y, px of the video.
        rate: frames a second.
        settings: of the search.
        guessed: whether the focal length is one; else it stays.

    Raises:
        InputError: sightings of other frames, a lens that no such video has, or no such rate.
    """
    require_sightings(sightings, frames, lens, rate)
    settings = settings or WaySettings()
    scale = sightings.scale
    focal, *middle = (lens[0] * scale, *(scale * (each + 0.5) - 0.5 for each in lens[1:]))
    lens = (focal, middle[0], middle[1])
    step = max(1, round(rate / settings.rate))
    keys = _key_frames(sightings, frames, step)
    if keys is None:
        return None
    chosen, times = keys
    turns = _chained(chosen, len(times), lens, settings)
    if turns is None:
        return None
    seen, names = _numbered(chosen)
    start = _start(seen, turns, lens, settings, len(names))
    prior = Prior(settings.lens if guessed else 0.0, settings.speed, settings.nearness)
    spacing = step / rate

    def solved(moves: bool) -> Adjusted:
        return Problem(seen, lens, spacing, start, prior, settings.tolerance, moves).solve()

    turned, moved = solved(moves=False), solved(moves=True)
    moves = _moves(turned, moved, len(times) - 1, len(names))
    best = moved if moves else turned
    agree = float((best.errors < settings.tolerance).mean())
    if agree < settings.explained:
        return None
    seen, names, start, begin = _standing(seen, names, start, best)
    if len(np.unique(seen.frame)) < len(times):  # nothing says how such a frame is turned
        return None
    best = Problem(seen, lens, spacing, start, prior, settings.tolerance, moves).solve(begin)
    return _every_frame(sightings, names, best, times, lens, frames, moves, agree)


def _key_frames(sightings: Sightings, frames: int, step: int) -> tuple[Sightings, Whole] | None:
    """Sightings in every so many frames, which are counted from 0, and which frames these are."""
    times = np.unique(np.append(np.arange(0, frames, step), frames - 1))
    if len(times) < _FEWEST:
        return None
    place = np.full(frames, -1)
    place[times] = np.arange(len(times))
    rows = place[sightings.frame]
    chosen = replace(sightings, frame=rows).part(rows >= 0)
    return chosen, times


def _chained(
    seen: Sightings, count: int, lens: tuple[float, float, float], settings: WaySettings
) -> Array | None:
    """Rotations (K, 3, 3) of a camera that only turns, from each key frame to the next."""
    rays = np.column_stack(((seen.pixels - lens[1:]) / lens[0], np.ones(len(seen))))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rows = [np.nonzero(seen.frame == frame)[0] for frame in range(count)]
    found = [np.eye(3)]
    for first, second in pairwise(rows):
        _, here, there = np.intersect1d(seen.point[first], seen.point[second], return_indices=True)
        if len(here) < settings.least:
            return None
        turn = _turn(rays[first[here]], rays[second[there]], settings.tolerance / lens[0])
        found.append(turn @ found[-1])
    return np.stack(found)


def _turn(rays: Array, others: Array, tolerance: float) -> Array:
    """The rotation that takes most of the unit vectors (N, 3) to the others, reweighted."""
    weight = np.ones(len(rays))
    turn = np.eye(3)
    for _ in range(_ROUNDS):
        left, _, right = np.linalg.svd((others * weight[:, None]).T @ rays)
        turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        error = np.linalg.norm(others - rays @ turn.T, axis=1)
        size = max(tolerance, 1.5 * float(np.median(error)))
        weight = 1 / np.square(1 + np.square(error / size))
    return turn


def _numbered(seen: Sightings) -> tuple[Sightings, Whole]:
    """Sightings of points that enough key frames see, counted from 0, and what they were."""
    often = np.bincount(seen.point)[seen.point] >= _FEWEST
    kept = seen.part(often)
    names, point = np.unique(kept.point, return_inverse=True)
    return replace(kept, point=point), names


def _start(
    seen: Sightings,
    turns: Array,
    lens: tuple[float, float, float],
    settings: WaySettings,
    count: int,
) -> Bundle:
    """A camera that turns, before a wall and above a floor: else what is near may become far."""
    rays = np.column_stack(((seen.pixels - lens[1:]) / lens[0], np.ones(len(seen))))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    direction = np.zeros((count, 3))
    np.add.at(direction, seen.point, np.einsum("nji,nj->ni", turns[seen.frame], rays))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    nearness = np.maximum(1 / settings.far, direction[:, 1] / settings.height)
    return Bundle(turns, np.zeros((len(turns), 3)), direction, nearness)


def _moves(turned: Adjusted, moved: Adjusted, places: int, points: int) -> bool:
    """Whether the sightings pay for a place a frame and a distance a point."""
    gain = 2 * (turned.cost - moved.cost) / moved.noise**2 / _ALIKE
    return gain > (3 * places + points) * math.log(2 * len(moved.errors))


def _standing(
    seen: Sightings, names: Whole, start: Bundle, found: Adjusted
) -> tuple[Sightings, Whole, Bundle, Bundle]:
    """Points that are hardly ever seen elsewhere than where they are; others walk, and bend a way.

    Returns:
        Their sightings, what they were, where they were supposed, and where they were found.
    """
    astray = found.errors > _ASTRAY * found.noise
    often = np.bincount(seen.point, astray) / np.bincount(seen.point)
    stands = often <= _SELDOM
    kept = seen.part(stands[seen.point])
    point = (np.cumsum(stands) - 1)[kept.point]

    def of_them(bundle: Bundle) -> Bundle:
        return replace(bundle, direction=bundle.direction[stands], nearness=bundle.nearness[stands])

    return replace(kept, point=point), names[stands], of_them(start), of_them(found.bundle)


def _every_frame(
    sightings: Sightings,
    names: Whole,
    best: Adjusted,
    times: Whole,
    lens: tuple[float, float, float],
    frames: int,
    moves: bool,
    agree: float,
) -> CameraWay:
    """Cameras of all frames from the points of the key frames, near the way between these."""
    bundle, every = best.bundle, np.arange(frames)
    between = Slerp(times, Rotation.from_matrix(bundle.rotation))(every).as_matrix()
    centres = -np.einsum("kji,kj->ki", bundle.rotation, bundle.translation)
    eyes = np.stack([np.interp(every, times, axis) for axis in centres.T], -1)
    place = np.full(int(sightings.point.max()) + 1, -1)
    place[names] = np.arange(len(names))
    known = place[sightings.point] >= 0
    seen = sightings.part(known)
    seen = replace(seen, point=place[seen.point])
    way = replace(bundle, rotation=between, translation=-np.einsum("fij,fj->fi", between, eyes))
    focal = lens[0] * math.exp(bundle.log_focal)
    way = _resected(seen, way, (focal, *lens[1:]), best.noise, moves)
    rotation = way.rotation @ way.rotation[0].T  # the world is the first frame's camera
    translation = way.translation - np.einsum("fij,j->fi", rotation, way.translation[0])
    factor = math.exp(bundle.log_focal)
    deviation = math.hypot(best.deviation, _LENS) if best.deviation else 0.0
    near = way.nearness > (_FARTHEST if moves else math.inf)
    points = way.direction[near] / way.nearness[near, None]
    points = points @ way.rotation[0].T + way.translation[0]
    return CameraWay(rotation, translation, factor, deviation, moves, agree, points)


def _resected(
    seen: Sightings, start: Bundle, lens: tuple[float, float, float], noise: float, moves: bool
) -> Bundle:
    """Each frame's camera where its sightings of known points agree, held near its start."""
    way, count = start, len(start.rotation)
    turn, shift = (np.full(3, (noise / each) ** 2) for each in _STEADY)
    held = np.concatenate((turn, shift))
    for step in range(_ROUNDS):
        size = max(3 * noise, _WIDE * _NARROWS**step)
        rays = way.seen(seen.frame, seen.point)
        error = lens[0] * rays[:, :2] / np.maximum(rays[:, 2:], 1e-3) + lens[1:] - seen.pixels
        weight = 1 / np.square(1 + np.square(error).sum(1) / size**2)
        slope = pixel_slope(rays, lens[0])
        near = way.nearness[seen.point, None]
        turned = rays - near * way.translation[seen.frame]
        rows = np.concatenate((-slope @ cross_matrix(turned), near[:, :, None] * slope), -1)
        weighed = rows * weight[:, None, None]
        matrix, right = np.zeros((count, 6, 6)), np.zeros((count, 6))
        np.add.at(matrix, seen.frame, np.einsum("nki,nkj->nij", weighed, rows))
        np.add.at(right, seen.frame, np.einsum("nki,nk->ni", weighed, error))
        away = (Rotation.from_matrix(way.rotation @ start.rotation.transpose(0, 2, 1))).as_rotvec()
        right += held * np.concatenate((away, way.translation - start.translation), 1)
        if not moves:
            matrix[:, 3:], matrix[:, :, 3:], right[:, 3:] = 0, 0, 0
            matrix[:, [3, 4, 5], [3, 4, 5]] = 1
        change = -np.linalg.solve(matrix + np.diag(held), right[..., None])[..., 0]
        way = replace(
            way,
            rotation=Rotation.from_rotvec(change[:, :3]).as_matrix() @ way.rotation,
            translation=way.translation + change[:, 3:],
        )
    return way
