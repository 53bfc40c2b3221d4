"""A lens that zooms: what is behind a person grows as no camera that walks lets it grow."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.matchmove._arguments import require_sightings
from perfcap.matchmove.bundle import cross_matrix, pixel_slope
from perfcap.matchmove.corner_tracks import Sightings

Array = NDArray[np.float64]

_GAP = 0.5  # s between two frames that are compared
_FEWEST, _PAIRS = 12, 2  # corners that two frames share, and pairs that say something
_AGREE, _MOST = 1.5, 0.8  # px of the shrunk image within which a zoom puts this share of them,
_SLIGHT = 0.05  # or share of how far a camera that only turns is off
_TURNED = 3.0  # px by which a camera that only turns is off, in the median, where a lens zooms
_LEAST = 0.1  # of the log focal length, over the clip; a camera in a hand comes nearer by less
_ROUNDS, _WIDE, _NARROWS = 30, 20.0, 0.6  # of a fit; px of its kernel, and each round's share


def find_zoom(
    sightings: Sightings, frames: int, lens: tuple[float, float, float], rate: float
) -> float | None:
    """How much longer the longest focal length is than the shortest; None of a lens that stays.

    Of a camera that turns and zooms, corners far and near grow alike; before one that walks, near
    ones grow more. A camera that walks straight towards a wall, and sees nothing else, looks the
    same: that is taken for a zoom, too.

    Args:
        sightings: of corners that stand still, and of some that do not.
        frames: of the clip.
        lens: focal length and principal point x, y, px of the video.
        rate: frames a second.

    Raises:
        InputError: sightings of other frames, a lens that no such video has, or no such rate.
    """
    require_sightings(sightings, frames, lens, rate)
    step, scale = max(1, round(_GAP * rate)), sightings.scale
    middle = scale * (np.array(lens[1:]) + 0.5) - 0.5
    grown, told, clear = [0.0], 0, 0
    for start in range(0, frames - step, step):
        first, second = (np.nonzero(sightings.frame == each)[0] for each in (start, start + step))
        points = sightings.point[first], sightings.point[second]
        _, here, there = np.intersect1d(*points, return_indices=True)
        if len(here) < _FEWEST:
            return None
        pair = (sightings.pixels[first[here]] - middle, sightings.pixels[second[there]] - middle)
        turned, _ = _fitted(*pair, scale * lens[0], zooms=False)
        errors, growth = _fitted(*pair, scale * lens[0], zooms=True)
        off = float(np.median(turned))
        if np.quantile(errors, _MOST) > max(_AGREE, _SLIGHT * off):
            return None
        told += 1
        clear += off > _TURNED
        grown.append(grown[-1] + growth)
    most = max(grown) - min(grown)
    return math.exp(most) if told >= _PAIRS and clear and most > _LEAST else None


def _fitted(here: Array, there: Array, focal: float, *, zooms: bool) -> tuple[Array, float]:
    """Errors (N,) in pixels of a camera that turns between two frames, and its log zoom.

    Args:
        here: pixels from the principal point in one frame, (N, 2).
        there: the same corners in the other.
        focal: length in the first one, px.
        zooms: whether the focal length changes.
    """
    rays = np.column_stack((here / focal, np.ones(len(here))))
    turn, growth = np.eye(3), 0.0
    for step in range(_ROUNDS):
        size = max(_AGREE, _WIDE * _NARROWS**step)
        turned = rays @ turn.T
        longer = focal * math.exp(growth)
        seen = longer * turned[:, :2] / turned[:, 2:]
        error = seen - there
        weight = 1 / np.square(1 + np.square(error).sum(1) / size**2)
        rows = np.concatenate(
            (-pixel_slope(turned, longer) @ cross_matrix(turned), seen[:, :, None]), -1
        )[:, :, : 4 if zooms else 3]
        matrix = np.einsum("n,nki,nkj->ij", weight, rows, rows) + 1e-9 * np.eye(rows.shape[-1])
        change = -np.linalg.solve(matrix, np.einsum("n,nki,nk->i", weight, rows, error))
        turn = Rotation.from_rotvec(change[:3]).as_matrix() @ turn
        growth += float(change[3:].sum())
    return np.linalg.norm(error, axis=1), growth
