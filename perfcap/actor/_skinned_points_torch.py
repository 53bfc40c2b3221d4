"""Chosen points of a skinned surface in plain torch; the oracle of the compiled twin.

A vertex x with the blended dual quaternion r + eps d, the sum of its joints' weighted
q_k + eps p_k, goes to the vector part of ``(r x r* + 2 d r*) / |r|^2``. A twist (w, v) changes the
summands of the joints it moves by ``(w q_k + eps (w p_k + v q_k)) / 2``; so each of these adds::

    (a0 - e0) w + w x (a + e) + m0 v + v x m + (w . m) p

to the velocity of the posed vertex p, with the quaternions ``m = q_k r* / |r|^2``,
``a = (q_k x r* + p_k r*) / |r|^2`` and ``e = d q_k* / |r|^2``. Where all joints move, m is 1, a and
e add up to p, and this is the rigid ``w x p + v``.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import pad

from perfcap.geometry.dual_quaternion import sign_to
from perfcap.geometry.rotation import quaternion_multiply, skew


class Skin(NamedTuple):
    """A rest mesh and what moves it."""

    vertices: Tensor  # (V, 3)
    joints: Tensor  # (V, K)
    weights: Tensor  # (V, K), 0 where there are fewer
    pivots: Tensor  # (V,), the heaviest joint


class Chosen(NamedTuple):
    """Points as weighted sums of vertices."""

    corners: Tensor  # (*b, F, N, S)
    weights: Tensor  # (*b, F, N, S)


class Unknowns(NamedTuple):
    """How the D unknowns of a frame move J joints."""

    twists: Tensor  # (*b, F, D, 6)
    topmost: Tensor  # (D,), the topmost joint each moves
    parents: Tensor  # (J,), -1 for the root, which comes first
    moved: Tensor  # (J, D), 1 where one moves a joint, else 0: what the two above say


def place(skin: Skin, chosen: Chosen, table: Tensor) -> Tensor:
    """Points (*b, F, N, 3) of joint motions (*b, F, J, 8), as dual quaternions, rest to posed."""
    blend = blended(skin, chosen, table)
    return _weigh(chosen, _move(blend, skin.vertices[chosen.corners]))


def linearize(
    skin: Skin, chosen: Chosen, table: Tensor, unknowns: Unknowns, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Points, and the derivative (*b, F, N, Q, D) of ``directions . points`` in unknowns.

    Directions are (*b, F, N, Q, 3), Q for each point.
    """
    parts, rest = _parts(skin, chosen, table), skin.vertices[chosen.corners]
    blend = parts.sum(-2)
    posed = _move(blend, rest)
    shares = chosen.weights[..., None, None, None] * _shares(parts, blend, rest, posed)
    joints = skin.joints[chosen.corners].flatten(-2)  # *b F N SK
    jacobian, twists = table.new_zeros(()), unknowns.twists.unsqueeze(-3).mT
    for share, joint in zip(shares.flatten(-4, -3).unbind(-3), joints.unbind(-1), strict=True):
        jacobian = jacobian + (directions @ share @ twists) * unknowns.moved[joint].unsqueeze(-2)
    return _weigh(chosen, posed), jacobian


def blended(skin: Skin, chosen: Chosen, table: Tensor) -> Tensor:
    """Dual quaternions of the corners, not yet of unit length, (*b, F, N, S, 8)."""
    return _parts(skin, chosen, table).sum(-2)


def _parts(skin: Skin, chosen: Chosen, table: Tensor) -> Tensor:
    """What is summed at each corner: signed and weighted joint motions, (*b, F, N, S, K, 8)."""
    rows = _pick(table, skin.joints[chosen.corners])
    pivots = _pick(table, skin.pivots[chosen.corners]).unsqueeze(-2)
    sign = sign_to(pivots[..., :4], rows[..., :4])
    return (sign * skin.weights[chosen.corners]).unsqueeze(-1) * rows


def _pick(table: Tensor, index: Tensor) -> Tensor:
    """Rows (*b, F, ..., n) of the tables (*b, F, J, n) of frames at index (*b, F, ...)."""
    flat = index.flatten(table.dim() - 2).unsqueeze(-1)
    return table.gather(-2, flat.expand(*flat.shape[:-1], table.shape[-1])).reshape(
        *index.shape, table.shape[-1]
    )


def _weigh(chosen: Chosen, vertices: Tensor) -> Tensor:
    """Points (*b, F, N, 3) of their corners (*b, F, N, S, 3)."""
    return (chosen.weights.unsqueeze(-1) * vertices).sum(-2)


def _move(blend: Tensor, rest: Tensor) -> Tensor:
    """Posed vertices (..., 3)."""
    back, turned = _back(blend, rest)
    turned = quaternion_multiply(blend[..., :4], turned)
    return (turned + 2 * quaternion_multiply(blend[..., 4:], back))[..., 1:]


def _back(blend: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
    """``r* / |r|^2`` and ``x r* / |r|^2``, (..., 4)."""
    real = blend[..., :4]
    back = _conjugate(real) / real.square().sum(-1, keepdim=True)
    return back, quaternion_multiply(pad(rest, (1, 0)), back)


def _shares(parts: Tensor, blend: Tensor, rest: Tensor, posed: Tensor) -> Tensor:
    """Velocity of the posed vertices by joint, (..., K, 3, 6), as a linear map of its twist."""
    back, turned = (x.unsqueeze(-2) for x in _back(blend, rest))
    real, dual = parts[..., :4], parts[..., 4:]
    m = quaternion_multiply(real, back)
    a = quaternion_multiply(real, turned) + quaternion_multiply(dual, back)
    length = blend[..., None, :4].square().sum(-1, keepdim=True)
    e = quaternion_multiply(blend[..., None, 4:] / length, _conjugate(real))
    one = torch.eye(3).to(m)
    spin = (a - e)[..., :1, None] * one - skew((a + e)[..., 1:])
    spin = spin + posed[..., None, :, None] * m[..., None, 1:]
    return torch.cat((spin, m[..., :1, None] * one - skew(m[..., 1:])), -1)


def _conjugate(quaternion: Tensor) -> Tensor:
    return quaternion * quaternion.new_tensor([1.0, -1.0, -1.0, -1.0])
