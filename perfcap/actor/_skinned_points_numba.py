"""Chosen points of a skinned surface as compiled loops, for plain tensors on the CPU.

Says the same as ``_skinned_points_torch.py``, where the formulas are explained.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor._skinned_points_torch import Chosen, Skin, Unknowns

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


def place(skin: Skin, chosen: Chosen, table: Tensor) -> Tensor:
    """Points (*b, F, N, 3) of joint motions (*b, F, J, 8)."""
    points = table.new_empty(*chosen.corners.shape[:-1], 3)
    _place(_surface(skin, chosen, table), _rows(points, 2))
    return points


def linearize(
    skin: Skin, chosen: Chosen, table: Tensor, unknowns: Unknowns
) -> tuple[Tensor, Tensor]:
    """Points and their derivative (*b, F, N, 3, D) in unknowns; see the torch twin."""
    points = table.new_empty(*chosen.corners.shape[:-1], 3)
    jacobian = table.new_zeros(*points.shape, unknowns.twists.shape[-2])
    _linearize(
        _surface(skin, chosen, table),
        _rows(unknowns.twists, 2),
        unknowns.topmost.numpy(),
        unknowns.parents.numpy(),
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


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
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


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _linearize(
    surface: _Surface,
    twists: Floats,
    topmost: Indices,
    parents: Indices,
    points: Floats,
    jacobian: Floats,
) -> None:
    """Points (N, P, 3) and their derivative (N, P, 3, D), which holds zeros before."""
    joints = len(parents)
    scratch = _Scratch(
        np.empty(surface.joints.shape[1]), np.zeros((joints, 13)), np.zeros(joints, np.bool_)
    )
    for n in range(points.shape[0]):
        for i in range(points.shape[1]):
            points[n, i, :] = 0
            for s in range(surface.corners.shape[2]):
                if surface.weights[n, i, s] != 0:
                    _add_corner(surface, n, i, s, scratch, points[n, i])
            _climb(parents, scratch)
            _turn(twists[n], topmost, scratch, jacobian[n, i])
            scratch.shares[:] = 0
            scratch.moves[:] = False


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _blend(surface: _Surface, n: int, vertex: int, signed: Floats) -> _Rigid:
    """Sum of a vertex's joint motions, with the signed weights of each."""
    table = surface.table[n]
    pivot = table[surface.pivots[vertex]]
    w, x, y, z, a, b, c, d = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(signed)):
        row, weight = table[surface.joints[vertex, k]], surface.joint_weights[vertex, k]
        side = pivot[0] * row[0] + pivot[1] * row[1] + pivot[2] * row[2] + pivot[3] * row[3]
        share = -weight if side < 0 else weight
        signed[k] = share
        w, x, y, z = w + share * row[0], x + share * row[1], y + share * row[2], z + share * row[3]
        a, b, c, d = a + share * row[4], b + share * row[5], c + share * row[6], d + share * row[7]
    return (w, x, y, z), (a, b, c, d)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _back(surface: _Surface, vertex: int, real: _Quaternion) -> tuple[_Quaternion, _Quaternion]:
    """``r* / |r|^2`` and ``x r* / |r|^2``."""
    w, x, y, z = real
    scale = 1 / (w * w + x * x + y * y + z * z)
    back = (scale * w, -scale * x, -scale * y, -scale * z)
    rest = surface.vertices[vertex]
    return back, _multiply((0.0, float(rest[0]), float(rest[1]), float(rest[2])), back)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _move(blend: _Rigid, back: _Quaternion, turned: _Quaternion) -> tuple[float, float, float]:
    """The posed vertex."""
    turned, shift = _multiply(blend[0], turned), _multiply(blend[1], back)
    return turned[1] + 2 * shift[1], turned[2] + 2 * shift[2], turned[3] + 2 * shift[3]


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _add_corner(
    surface: _Surface, n: int, i: int, s: int, scratch: _Scratch, point: Floats
) -> None:
    """Add a corner to a point, and to the share of each joint in the point's velocity."""
    weight, vertex = surface.weights[n, i, s], surface.corners[n, i, s]
    blend = _blend(surface, n, vertex, scratch.signed)
    back, turned = _back(surface, vertex, blend[0])
    at = _move(blend, back, turned)
    for k in range(3):
        point[k] += weight * at[k]
    scale = _length(back) * weight
    u, v, w, x = blend[1]
    dual = (scale * u, scale * v, scale * w, scale * x)
    for k in range(len(scratch.signed)):
        share = scratch.signed[k]
        if share != 0:
            row = surface.table[n, surface.joints[vertex, k]]
            real = (share * row[0], share * row[1], share * row[2], share * row[3])
            m = _multiply(real, back)
            shift = (share * row[4], share * row[5], share * row[6], share * row[7])
            a, b = _multiply(real, turned), _multiply(shift, back)
            e = _multiply(dual, (real[0], -real[1], -real[2], -real[3]))
            _add_share(scratch, surface.joints[vertex, k], weight, (m, a, b, e), at)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _add_share(
    scratch: _Scratch,
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
    share = scratch.shares[joint]
    for j in range(4):
        share[9 + j] += weight * m[j]
    for i in range(3):
        share[3 * i + i] += along
        for j in range(3):
            share[3 * i + j] += weight * at[i] * m[1 + j]
    share[1] += z
    share[2] -= y
    share[3] -= z
    share[5] += x
    share[6] += y
    share[7] -= x
    scratch.moves[joint] = True


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _climb(parents: Indices, scratch: _Scratch) -> None:
    """Add to every joint's share those of the joints below it, which come later."""
    for joint in range(len(parents) - 1, 0, -1):
        if scratch.moves[joint]:
            parent = parents[joint]
            scratch.moves[parent] = True
            for k in range(13):
                scratch.shares[parent, k] += scratch.shares[joint, k]


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _turn(twists: Floats, topmost: Indices, scratch: _Scratch, jacobian: Floats) -> None:
    """Derivative (3, D) of a point: each unknown's twist through the share of what it moves."""
    for d in range(len(topmost)):
        if scratch.moves[topmost[d]]:
            s = scratch.shares[topmost[d]]
            w, v = (
                (twists[d, 0], twists[d, 1], twists[d, 2]),
                (twists[d, 3], twists[d, 4], twists[d, 5]),
            )
            a, b, c, e = s[9], s[10], s[11], s[12]
            jacobian[0, d] = (
                s[0] * w[0] + s[1] * w[1] + s[2] * w[2] + a * v[0] + v[1] * e - v[2] * c
            )
            jacobian[1, d] = (
                s[3] * w[0] + s[4] * w[1] + s[5] * w[2] + a * v[1] + v[2] * b - v[0] * e
            )
            jacobian[2, d] = (
                s[6] * w[0] + s[7] * w[1] + s[8] * w[2] + a * v[2] + v[0] * c - v[1] * b
            )


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _length(quaternion: _Quaternion) -> float:
    """Squared length."""
    w, x, y, z = quaternion
    return w * w + x * x + y * y + z * z


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
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
