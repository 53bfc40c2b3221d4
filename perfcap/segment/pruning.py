"""Which pairs of contour points to believe.

A silhouette that is wrong somewhere has a wrong contour there, and the model must stay as it is
(MPC-25). Beyond distance and angle, three things tell such places apart: right matches lie ahead
of their points and not along the contour, neighbours move alike, and a limb's two sides move
together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
_EVERY = 3


def slide(offset: Floats, normals: Floats) -> Floats:
    """How far targets lie off the normals through their model points, (N,) px.

    The nearest point of a contour lies straight ahead. Where a match runs along the contour
    instead, the contour's own counterpart is missing, and the match is the end of what is left.

    Args:
        offset: target minus model point, (N, 2) px.
        normals: unit, (N, 2).
    """
    return np.abs(offset[:, 0] * normals[:, 1] - offset[:, 1] * normals[:, 0])


def nearest_claim(target: Integers, distance: Floats) -> Flags:
    """Which of the rows (N,) that claim a target is the nearest to it; of equals, the first."""
    order = np.lexsort((distance, target))
    first = np.ones(len(order), bool)
    first[1:] = target[order[1:]] != target[order[:-1]]
    kept = np.zeros(len(order), bool)
    kept[order[first]] = True
    return kept


def support(
    points: Floats,
    normals: Floats,
    shift: Floats,
    chosen: Integers,
    counts: Flags,
    tolerance: tuple[float, float],
    neighbours: int,
    radius: float,
) -> Floats:
    """Share of its neighbours on the contour that move as a point does.

    Neighbours are the nearest points within a radius whose normals differ by less than 60 degrees;
    those without a match do not move as the point does.

    Args:
        points: all contour points of the model, (P, 2) px.
        normals: theirs, unit, (P, 2).
        shift: signed displacement along the normal, NaN without a match, (P,) px.
        chosen: points to judge, (N,), all of them matched.
        counts: points that may be neighbours of points for which this is True too; those for
            which it is False may neighbour each other only and are joined by the rest, (P,).
        tolerance: px, and px per pixel between the two, that shifts may differ.
        neighbours: most of them, of a sample of the points.
        radius: px.

    Returns:
        (N,), 0 for a point with fewer than two neighbours.
    """
    if not len(chosen):
        return np.zeros(0)
    # a part of the points, which come in no order along the contour, tell as much as all
    asked = np.arange(0, len(points), _EVERY)
    ranks = [*range(1, min(neighbours, len(asked)) + 1)]
    gap, index = cKDTree(points[asked]).query(points[chosen], k=ranks, distance_upper_bound=radius)
    none = np.isinf(gap)
    index = np.where(none, chosen[:, None], asked[np.where(none, 0, index)])
    x, y = normals.T
    alike = x[index] * x[chosen, None] + y[index] * y[chosen, None] > 0.5
    near = (index != chosen[:, None]) & alike & (counts[index] | ~counts[chosen][:, None])
    with np.errstate(invalid="ignore"):
        allowed = tolerance[0] + tolerance[1] * np.where(near, gap, 0.0)
        agree = near & (np.abs(shift[index] - shift[chosen][:, None]) <= allowed)
    count = near.sum(1)
    return np.where(count >= 2, agree.sum(1) / np.maximum(count, 1), 0.0)


def crosses(
    points: Floats,
    normals: Floats,
    movement: Floats,
    chosen: Integers,
    scale: float,
    margin: float,
) -> Flags:
    """Which matches reach through a model contour that faces the other way and does not give way.

    That is the far side of the limb a point is on, or the near side of another part. The match is
    possible if that side moves along, by at least half as much.

    Args:
        points: all contour points of the model, (P, 2) px.
        normals: theirs, unit, (P, 2).
        movement: from each to its target, zero without a match, (P, 2) px.
        chosen: points to judge, (N,).
        scale: px that a difference of one between normals counts as.
        margin: px by which a match may reach beyond.

    Returns:
        (N,).
    """
    through = np.zeros(len(chosen), bool)
    # no limb is thinner than twice that
    far = np.flatnonzero(np.linalg.norm(movement[chosen], axis=1) > 2 * margin)
    if not len(far):
        return through
    tree = cKDTree(np.concatenate([points, scale * normals], 1))
    start, ahead, offset = (each[chosen[far]] for each in (points, normals, movement))
    for share in (0.5, 1.0):  # a thin limb is nearest half way, a thick one at the end
        place = start + share * offset
        _, other = tree.query(np.concatenate([place, -scale * ahead], 1))
        facing = normals[other]
        before = _dot(start - points[other], facing)
        after = _dot(start + offset - points[other], facing)
        beside = slide(place - points[other], facing)
        passed = (before * after < 0) & (np.abs(after) > margin) & (beside < 2 * margin)
        opposite = _dot(facing, ahead) < -0.5
        along = _dot(movement[other], offset) > 0.5 * _dot(offset, offset)
        through[far] |= passed & opposite & ~along
    return through


def _dot(a: Floats, b: Floats) -> Floats:
    """Scalar products of rows, (N,)."""
    out: Floats = np.einsum("nx,nx->n", a, b)
    return out
