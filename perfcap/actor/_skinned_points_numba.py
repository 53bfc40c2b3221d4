"""Chosen points of a skinned surface as compiled loops, for plain tensors on the CPU.

Says the same as ``_skinned_points_torch.py``, where the formulas are explained.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor._skinned_points_torch import Chosen, Skin, Unknowns
from perfcap.kernels import inner, kernel

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]
_Quaternion = tuple[float, float, float, float]
_Rigid = tuple[_Quaternion, _Quaternion]  # real and dual part


class _Surface(NamedTuple):
    """What the kernels read, for N poses with P points of S corners each."""

    vertices: Floats  # (V, 3)
    joints: Indices  # (V, K)
    joint_weights: Floats  # (V, K)
    pivots: Indices  # (V,)
    corners: Indices  # (N, P, S)
    weights: Floats  # (N, P, S)
    table: Floats  # (N, J, 8)


class _Scratch(NamedTuple):
    """What is known of one point while its corners are added up."""

    signed: Floats  # (K,) joint weights of a vertex, with the sign of the joint's quaternion
    shares: Floats  # (J, 13) of each joint: how w moves the point, (3, 3), and the quaternion m
    moves: NDArray[np.bool_]  # (J,) whether the joint moves the point
    pulls: Floats  # (J, 6) how a twist of the joint moves it along a direction


def place(skin: Skin, chosen: Chosen, table: Tensor) -> Tensor:
    """Points (*b, F, N, 3) of joint motions (*b, F, J, 8)."""
    points = table.new_empty(*chosen.corners.shape[:-1], 3)
    _place(_surface(skin, chosen, table), _rows(points, 2))
    return points


def linearize(
    skin: Skin, chosen: Chosen, table: Tensor, unknowns: Unknowns, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Points and the derivative (*b, F, N, Q, D) of directions . points; see the torch twin."""
    points = table.new_empty(*chosen.corners.shape[:-1], 3)
    jacobian = table.new_zeros(*directions.shape[:-1], unknowns.twists.shape[-2])
    _linearize(
        _surface(skin, chosen, table),
        _rows(unknowns.twists, 2),
        unknowns.topmost.numpy(),
        unknowns.parents.numpy(),
        _rows(directions, 3),
        _rows(points, 2),
        _rows(jacobian, 3),
    )
    return points, jacobian


def _surface(skin: Skin, chosen: Chosen, table: Tensor) -> _Surface:
    vertices, joints, weights, pivots = (np.ascontiguousarray(x.detach().numpy()) for x in skin)
    per_pose = (_rows(x, 2) for x in (chosen.corners, chosen.weights, table))
    return _Surface(vertices, joints, weights, pivots, *per_pose)


def _rows(tensor: Tensor, keep: int) -> Any:
    """Contiguous with the first axes as one: another memory layout would compile once more."""
    shape = tensor.shape[:-keep].numel(), *tensor.shape[-keep:]
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(shape)


@kernel()
def _place(surface: _Surface, points: Floats) -> None:
    """Points (N, P, 3)."""
    signed = np.empty(surface.joints.shape[1])
    for n in range(points.shape[0]):
        for i in range(points.shape[1]):
            points[n, i, :] = 0
            for s in range(surface.corners.shape[2]):
                weight, vertex = surface.weights[n, i, s], surface.corners[n, i, s]
                if weight != 0:
                    blend = _blend(surface, n, vertex, signed)
                    at = _move(blend, *_back(surface, vertex, blend[0]))
                    for k in range(3):
                        points[n, i, k] += weight * at[k]


@kernel()
def _linearize(
    surface: _Surface,
    twists: Floats,
    topmost: Indices,
    parents: Indices,
    directions: Floats,
    points: Floats,
    jacobian: Floats,
) -> None:
    """Points (N, P, 3) and their derivative (N, P, Q, D), which holds zeros before."""
    joints = len(parents)
    scratch = _Scratch(
        np.empty(surface.joints.shape[1]),
        np.zeros((joints, 13)),
        np.zeros(joints, np.bool_),
        np.empty((joints, 6)),
    )
    for n in range(points.shape[0]):
        for i in range(points.shape[1]):
            points[n, i, :] = 0
            for s in range(surface.corners.shape[2]):
                if surface.weights[n, i, s] != 0:
                    _add_corner(surface, n, i, s, scratch, points)
            _climb(parents, scratch)
            for q in range(directions.shape[2]):
                x, y, z = directions[n, i, q, 0], directions[n, i, q, 1], directions[n, i, q, 2]
                _pull(scratch, x, y, z)
                for d in range(len(topmost)):
                    if scratch.moves[topmost[d]]:
                        jacobian[n, i, q, d] = _along(scratch.pulls, topmost[d], twists, n, d)
            scratch.shares[:] = 0
            scratch.moves[:] = False


@inner()
def _blend(surface: _Surface, n: int, vertex: int, signed: Floats) -> _Rigid:
    """Sum of a vertex's joint motions, with the signed weights of each."""
    table, pivot = surface.table, surface.pivots[vertex]
    w, x, y, z, a, b, c, d = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(signed)):
        joint, share = surface.joints[vertex, k], surface.joint_weights[vertex, k]
        if share != 0:
            side = 0.0
            for q in range(4):
                side += table[n, pivot, q] * table[n, joint, q]
            share = -share if side < 0 else share
            w, x = w + share * table[n, joint, 0], x + share * table[n, joint, 1]
            y, z = y + share * table[n, joint, 2], z + share * table[n, joint, 3]
            a, b = a + share * table[n, joint, 4], b + share * table[n, joint, 5]
            c, d = c + share * table[n, joint, 6], d + share * table[n, joint, 7]
        signed[k] = share
    return (w, x, y, z), (a, b, c, d)


@inner()
def _back(surface: _Surface, vertex: int, real: _Quaternion) -> tuple[_Quaternion, _Quaternion]:
    """``r* / |r|^2`` and ``x r* / |r|^2``."""
    w, x, y, z = real
    scale = 1 / (w * w + x * x + y * y + z * z)
    back = (scale * w, -scale * x, -scale * y, -scale * z)
    rest = surface.vertices
    at = float(rest[vertex, 0]), float(rest[vertex, 1]), float(rest[vertex, 2])
    return back, _multiply((0.0, *at), back)


@inner()
def _move(blend: _Rigid, back: _Quaternion, turned: _Quaternion) -> tuple[float, float, float]:
    """The posed vertex."""
    turned, shift = _multiply(blend[0], turned), _multiply(blend[1], back)
    return turned[1] + 2 * shift[1], turned[2] + 2 * shift[2], turned[3] + 2 * shift[3]


@inner()
def _add_corner(
    surface: _Surface, n: int, i: int, s: int, scratch: _Scratch, points: Floats
) -> None:
    """Add a corner to a point, and to the share of each joint in the point's velocity."""
    weight, vertex = surface.weights[n, i, s], surface.corners[n, i, s]
    blend = _blend(surface, n, vertex, scratch.signed)
    back, turned = _back(surface, vertex, blend[0])
    at = _move(blend, back, turned)
    for k in range(3):
        points[n, i, k] += weight * at[k]
    scale = _length(back) * weight
    u, v, w, x = blend[1]
    dual = (scale * u, scale * v, scale * w, scale * x)
    for k in range(len(scratch.signed)):
        share = scratch.signed[k]
        if share != 0:
            joint = surface.joints[vertex, k]
            real = _scaled(surface.table, n, joint, 0, share)
            shift = _scaled(surface.table, n, joint, 4, share)
            m, a, b = _multiply(real, back), _multiply(real, turned), _multiply(shift, back)
            e = _multiply(dual, (real[0], -real[1], -real[2], -real[3]))
            _add_share(scratch.shares, joint, weight, (m, a, b, e), at)
            scratch.moves[joint] = True


@inner()
def _scaled(table: Floats, n: int, joint: int, part: int, share: float) -> _Quaternion:
    """A share of the real (0) or dual (4) part of a joint's motion."""
    return (
        share * table[n, joint, part],
        share * table[n, joint, part + 1],
        share * table[n, joint, part + 2],
        share * table[n, joint, part + 3],
    )


@inner()
def _add_share(
    shares: Floats,
    joint: int,
    weight: float,
    parts: tuple[_Quaternion, _Quaternion, _Quaternion, _Quaternion],
    at: tuple[float, float, float],
) -> None:
    """Add the velocity that a joint gives a vertex; ``e`` is weighted already."""
    m, a, b, e = parts
    x, y, z = (
        weight * (a[1] + b[1]) + e[1],
        weight * (a[2] + b[2]) + e[2],
        weight * (a[3] + b[3]) + e[3],
    )
    along = weight * (a[0] + b[0]) - e[0]
    r, s, t, u = weight * m[0], weight * m[1], weight * m[2], weight * m[3]
    # row i: along * one - skew(x, y, z) + at m
    shares[joint, 0] += along + at[0] * s
    shares[joint, 1] += z + at[0] * t
    shares[joint, 2] += at[0] * u - y
    shares[joint, 3] += at[1] * s - z
    shares[joint, 4] += along + at[1] * t
    shares[joint, 5] += x + at[1] * u
    shares[joint, 6] += y + at[2] * s
    shares[joint, 7] += at[2] * t - x
    shares[joint, 8] += along + at[2] * u
    shares[joint, 9] += r
    shares[joint, 10] += s
    shares[joint, 11] += t
    shares[joint, 12] += u


@inner()
def _climb(parents: Indices, scratch: _Scratch) -> None:
    """Add to every joint's share those of the joints below it, which come later."""
    for joint in range(len(parents) - 1, 0, -1):
        if scratch.moves[joint]:
            parent = parents[joint]
            scratch.moves[parent] = True
            for k in range(13):
                scratch.shares[parent, k] += scratch.shares[joint, k]


@inner()
def _pull(scratch: _Scratch, x: float, y: float, z: float) -> None:
    """How twists of every joint that moves the point move it along a direction."""
    shares = scratch.shares
    for joint in range(len(shares)):
        if scratch.moves[joint]:
            for k in range(3):
                scratch.pulls[joint, k] = (
                    x * shares[joint, k] + y * shares[joint, 3 + k] + z * shares[joint, 6 + k]
                )
            a, b, c, d = shares[joint, 9], shares[joint, 10], shares[joint, 11], shares[joint, 12]
            scratch.pulls[joint, 3] = a * x + c * z - d * y
            scratch.pulls[joint, 4] = a * y + d * x - b * z
            scratch.pulls[joint, 5] = a * z + b * y - c * x


@inner()
def _along(pulls: Floats, joint: int, twists: Floats, n: int, d: int) -> float:
    """Velocity along the direction that unknown d gives the point."""
    turned: float = (
        pulls[joint, 0] * twists[n, d, 0]
        + pulls[joint, 1] * twists[n, d, 1]
        + pulls[joint, 2] * twists[n, d, 2]
    )
    shifted: float = (
        pulls[joint, 3] * twists[n, d, 3]
        + pulls[joint, 4] * twists[n, d, 4]
        + pulls[joint, 5] * twists[n, d, 5]
    )
    return turned + shifted


@inner()
def _length(quaternion: _Quaternion) -> float:
    """Squared length."""
    w, x, y, z = quaternion
    return w * w + x * x + y * y + z * z


@inner()
def _multiply(left: _Quaternion, right: _Quaternion) -> _Quaternion:
    """Hamilton product."""
    a, b, c, d = left
    e, f, g, h = right
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g + c * e + d * f - b * h,
        a * h + d * e + b * g - c * f,
    )
