"""The ground among points of the background: a level plane below the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_shape
from perfcap.matchmove._arguments import require_deviation, require_direction
from perfcap.setting_checks import Settings

Array = NDArray[np.float64]

_DRAWN = 2000  # planes through three points that are tried
_ROUNDS = 10  # of the fit
_ALIKE = 5.0  # neighbouring points whose errors are as good as one


@dataclass(frozen=True)
class GroundSettings(Settings):
    """How the ground is found.

    Attributes:
        cone: degrees about the start, in which its normal lies.
        within: distance of points from the plane by that from the camera, at which they agree.
        least: points that must.
        share: of all points that must.
        spread: of them along each direction of the plane, deviations by their mean distance.
    """

    cone: float = 15.0
    within: float = 0.015
    least: int = 25
    share: float = 0.1
    spread: float = 0.05


@dataclass(frozen=True)
class Ground:
    """The plane ``normal . x = height``.

    Attributes:
        normal: up, a unit vector (3,).
        height: negative, in the unit of the points: the camera is at the origin.
        deviation: expected error of the normal, radians.
    """

    normal: Array
    height: float
    deviation: float


def find_ground(
    points: Array,
    start: Array,
    deviation: float,
    settings: GroundSettings | None = None,
    seed: int = 0,
) -> Ground | None:
    """The plane below the origin, nearly level, on which most points are (RANSAC).

    Args:
        points: (P, 3), seen from near the origin.
        start: about up, a unit vector (3,).
        deviation: of up about it, radians: points that are all far away hardly tell a tilt.
        settings: of the search.
        seed: of the planes that are tried.

    Returns:
        None where too few points agree, or they lie on a line.

    Raises:
        InputError: no points, no unit vector, or a deviation that is none in radians.
    """
    require_shape(points, "points", (None, 3), "(P, 3), places in space")
    require_direction(start)
    require_deviation(deviation)
    settings = settings or GroundSettings()
    if len(points) < settings.least:
        return None
    away = settings.within * np.linalg.norm(points, axis=1)
    rng = np.random.default_rng(seed)
    drawn = points[rng.integers(0, len(points), (_DRAWN, 3))]
    normals = np.cross(drawn[:, 1] - drawn[:, 0], drawn[:, 2] - drawn[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 0] / length[length > 0, None]
    normals *= np.where(normals @ start < 0, -1, 1)[:, None]
    heights = (normals * drawn[length > 0, 0]).sum(-1)
    likely = (normals @ start > math.cos(math.radians(settings.cone))) & (heights < 0)
    if not likely.any():
        return None
    normals, heights = normals[likely], heights[likely]
    agree = np.abs(points @ normals.T - heights) < away[:, None]
    best = int(agree.sum(0).argmax())
    guess = normals[best], float(heights[best])
    normal, height, tilt = _fitted(points, *guess, start, deviation, away)
    near = np.abs(points @ normal - height) < away
    if near.sum() < max(settings.least, settings.share * len(points)) or height >= 0:
        return None
    if normal @ start < math.cos(math.radians(settings.cone)):
        return None
    own = points[near]
    along = np.linalg.svd(own - own.mean(0), compute_uv=False)[1] / math.sqrt(len(own))
    if along < settings.spread * np.linalg.norm(own, axis=1).mean():
        return None
    return Ground(normal, height, tilt)


def _fitted(
    points: Array, normal: Array, height: float, start: Array, deviation: float, away: Array
) -> tuple[Array, float, float]:
    """Normal, held about a start, height and tilt's deviation of the plane that points agree on."""
    axis = np.cross(start, np.eye(3)[int(np.abs(start).argmin())])
    axis /= np.linalg.norm(axis)
    across = np.stack((axis, np.cross(start, axis)), -1)
    tilt = normal @ across / (normal @ start)
    height /= float(normal @ start)
    rows = np.column_stack((points @ across, -np.ones(len(points))))
    prior = np.array([deviation**-2, deviation**-2, 0.0])
    for _ in range(_ROUNDS):
        error = (points @ start + rows @ np.append(tilt, height)) / away
        weight = 1 / np.square(1 + np.square(error)) / away**2 / _ALIKE
        matrix = rows.T @ (weight[:, None] * rows) + np.diag(prior)
        found = np.linalg.solve(matrix, -rows.T @ (weight * (points @ start)))
        tilt, height = found[:2], float(found[2])
    length = math.sqrt(1 + float(tilt @ tilt))
    unit: Array = (start + across @ tilt) / length
    spread = np.linalg.inv(matrix).diagonal()[:2].mean()
    return unit, height / length, math.sqrt(spread)
