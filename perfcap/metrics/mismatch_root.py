"""Hips and bodies of a truth that are of different worlds or units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.geometry.alignment import Similarity, procrustes
from perfcap.geometry.rotation import matrix_to_rotvec
from perfcap.metrics.alignment import HIPS, root_aligned, root_of

_FAR = 0.05  # m: nearer joints need no explanation
_LEFT = 0.4  # share of the error that one rotation may leave
_TURN = 10.0  # degrees
_FEWEST = 10  # frames
# Of the paths of hips: how far they go, share of the error that is left, and by how many times they
# differ at least. Depth of one view makes paths longer towards it: a fifth is left of some
_GOES, _HARDLY, _LARGER = 0.1, 0.12, 1.5
_STRAIGHT = 0.2  # share of a path's length that it goes aside: of less, no rotation is known
_NO_DEPTH = 2.0  # m that no depth of one view is off by


def root_mismatches(estimate: Tensor, truth: Tensor, valid: Tensor) -> Iterator[str]:
    """That bodies or paths of the hips are explained by a rotation or a factor of their own.

    Both are of one world in a capture: what turns the one turns the other.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
    """
    seen = valid[:, list(HIPS)].all(-1)
    if int(seen.sum()) < _FEWEST:
        return
    estimate, truth, valid = estimate[seen], truth[seen], valid[seen]
    whole = _fitted(estimate[valid], truth[valid])
    body = _fitted(root_aligned(estimate)[valid], root_aligned(truth)[valid])
    one_world = whole.left < _LEFT and not _differ(whole, body)
    if not one_world:
        yield from _turned(body)
    yield from _path(root_of(estimate), root_of(truth), body, whole.left < _LEFT)


@dataclass(frozen=True)
class _Fit:
    """One motion of all points that leaves least.

    Attributes:
        now: mean distance before, m.
        left: and after it, as a share of that.
        angle: of its rotation, degrees.
        image: whether it is that of a mirror.
        larger: by how many times a similarity makes the points larger.
        motion: the motion.
    """

    now: float
    left: float
    angle: float
    image: bool
    larger: float
    motion: Similarity


def _fitted(source: Tensor, target: Tensor, scale: bool = False) -> _Fit:
    """The motion of points (N, 3) onto others, which may be that of a mirror."""
    now = float((source - target).norm(dim=-1).mean())
    fits = []
    for image in (False, True):
        points = source * source.new_tensor([-1.0 if image else 1.0, 1.0, 1.0])
        motion = procrustes(points, target, scale=scale)
        left = float((motion.apply(points) - target).norm(dim=-1).mean()) / max(now, 1e-9)
        larger = max(float(procrustes(points, target).scale), 1e-9)
        fits.append(_Fit(now, left, _angle(motion.rotation), image, larger, motion))
    plain, mirrored = fits
    return mirrored if mirrored.left < _LEFT * plain.left else plain


def _differ(first: _Fit, second: _Fit) -> bool:
    """Whether two motions turn what they move differently."""
    if first.image != second.image:
        return True
    between = first.motion.rotation @ second.motion.rotation.mT
    return _angle(between) > _TURN


def _angle(rotation: Tensor) -> float:
    """Of a matrix (3, 3), degrees."""
    return float(matrix_to_rotvec(rotation).norm().rad2deg())


def _turned(body: _Fit) -> Iterator[str]:
    if body.now < _FAR or body.left >= _LEFT:
        return
    if body.image:
        yield (
            f"with bodies of the truth in a mirror {body.left:.0%} of their error about the hips "
            "is left, and the hips are not; one axis of them runs the other way"
        )
    elif body.angle > _TURN:
        yield (
            f"after one rotation of all bodies about their hips by {body.angle:.0f} degrees "
            f"{body.left:.0%} of their error is left, and the hips need none; give hips and bodies "
            "of the truth in one world"
        )


def _path(own: Tensor, true: Tensor, body: _Fit, moved: bool) -> Iterator[str]:
    """The paths (F, 3) of the hips, and whether one motion of everything explains them."""
    apart = own - own.mean(0)
    goes = torch.linalg.svdvals(apart) / len(own) ** 0.5
    path = _fitted(own, true, scale=bool(goes[0] > _GOES))
    if path.now < _FAR:
        return
    factor = path.larger
    # a path that has nothing in common with the other one shrinks to a point in its middle
    follows = path.left * path.now < _HARDLY * float((true - true.mean(0)).norm(dim=-1).mean())
    resized = not 1 / _LARGER < factor / body.larger < _LARGER
    turned = bool(goes[1] > _STRAIGHT * goes[0]) and _differ(path, body)
    if goes[0] > _GOES and path.left < _HARDLY and follows and (resized or turned):
        how = [f"{factor:.2g} times as long"] * resized + ["turned or mirrored"] * turned
        yield (
            f"if the way of the hips of the truth is {' and '.join(how)}, {path.left:.0%} of their "
            "error is left, and bodies about them are not so; give hips and bodies of the truth "
            "in one world and one unit"
        )
    elif not moved and path.now > max(_NO_DEPTH, 10 * body.now):
        yield (
            f"the hips are {path.now:.1f} m off, and bodies about them {1000 * body.now:.0f} mm; "
            "check world and unit of the hips of the truth"
        )
