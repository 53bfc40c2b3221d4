"""Rotations: rotation vectors (radians), unit quaternions (w, x, y, z) and matrices.

Every map takes any batch ``*b``, is differentiable (also in forward mode) and finite with finite
derivatives at the identity. At an angle of pi a rotation vector is unique up to sign only; either
is returned. Quaternions q and -q are the same rotation; ``aligned`` picks signs along a curve.
"""

from __future__ import annotations

import kornia.geometry.conversions as kornia_conversions
import torch
from torch import Tensor

from perfcap.geometry.plain import is_plain

_SHORT = 1e-3  # radians: below, the first terms of a series are exact


def rotvec_to_quaternion(rotvec: Tensor) -> Tensor:
    """Unit quaternion (*b, 4) of a rotation vector (*b, 3)."""
    squared = rotvec.square().sum(-1, keepdim=True)
    small = squared < torch.finfo(rotvec.dtype).eps
    angle = torch.where(small, torch.ones_like(squared), squared).sqrt()
    # sin(a/2)/a = 1/2 - a^2/48 + O(a^4): exact to rounding where the square root is unsafe
    factor = torch.where(small, 0.5 - squared / 48, (0.5 * angle).sin() / angle)
    real = torch.where(small, 1 - squared / 8, (0.5 * angle).cos())
    return torch.cat((real, factor * rotvec), -1)


def quaternion_to_rotvec(quaternion: Tensor) -> Tensor:
    """Rotation vector (*b, 3) with angle in [0, pi] of a unit quaternion (*b, 4)."""
    positive = torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    real, imaginary = positive[..., :1], positive[..., 1:]
    squared = imaginary.square().sum(-1, keepdim=True)
    small = squared < torch.finfo(quaternion.dtype).eps
    norm = torch.where(small, torch.ones_like(squared), squared).sqrt()
    # 2 atan2(s, w)/s = (2/w) (1 - s^2/(3 w^2)) + O(s^4)
    near = torch.where(small, real, torch.ones_like(real))  # real is zero at half a turn
    series = (2 - 2 * squared / (3 * near.square())) / near
    return torch.where(small, series, 2 * torch.atan2(norm, real) / norm) * imaginary


def quaternion_multiply(left: Tensor, right: Tensor) -> Tensor:
    """Hamilton product (*b, 4): rotating by the result is rotating by ``right``, then ``left``."""
    a, u = left[..., :1], left[..., 1:]
    b, v = right[..., :1], right[..., 1:]
    real = a * b - (u * v).sum(-1, keepdim=True)
    return torch.cat((real, a * v + b * u + torch.linalg.cross(u, v)), -1)


def compose_rotvec(left: Tensor, right: Tensor) -> Tensor:
    """Rotation vector (*b, 3), angle in [0, pi], of rotating by ``right``, then by ``left``."""
    if is_plain(left, right) and left.shape[-1:] == right.shape[-1:] == (3,):
        from perfcap.geometry._rotation_numba import compose

        return compose(left, right)
    product = quaternion_multiply(rotvec_to_quaternion(left), rotvec_to_quaternion(right))
    return quaternion_to_rotvec(product)


def quaternion_to_matrix(quaternion: Tensor) -> Tensor:
    """Rotation matrix (*b, 3, 3) of a unit quaternion (*b, 4)."""
    w, x, y, z = (2**0.5 * quaternion).unbind(-1)
    rows = (
        1 - y * y - z * z, x * y - w * z, x * z + w * y,
        x * y + w * z, 1 - x * x - z * z, y * z - w * x,
        x * z - w * y, y * z + w * x, 1 - x * x - y * y,
    )  # fmt: skip
    return torch.stack(rows, -1).reshape(*w.shape, 3, 3)


def matrix_to_quaternion(matrix: Tensor) -> Tensor:
    """Unit quaternion (*b, 4) of a rotation matrix (*b, 3, 3), of either sign."""
    return torch.nn.functional.normalize(
        kornia_conversions.rotation_matrix_to_quaternion(matrix), dim=-1
    )


def rotvec_to_matrix(rotvec: Tensor) -> Tensor:
    """Rotation matrix (*b, 3, 3) of a rotation vector (*b, 3)."""
    return quaternion_to_matrix(rotvec_to_quaternion(rotvec))


def matrix_to_rotvec(matrix: Tensor) -> Tensor:
    """Rotation vector (*b, 3) with angle in [0, pi] of a rotation matrix (*b, 3, 3)."""
    return quaternion_to_rotvec(matrix_to_quaternion(matrix))


def skew(vector: Tensor) -> Tensor:
    """Matrix [v] (*b, 3, 3) with [v] u = v x u."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), -1).reshape(*x.shape, 3, 3)


def turn_to_y(up: Tensor) -> Tensor:
    """Rotation (3, 3) that takes a unit vector of the world, (3,), to +y by the smallest turn.

    A world that hangs upside down is turned over about x, as images are against the world: there
    the smallest turn is any of half a turn, and noise would choose the heading.
    """
    if float(up[1]) < -0.5:
        over = torch.diag(up.new_tensor([1.0, -1.0, -1.0]))
        return turn_to_y(over @ up) @ over
    cross = skew(torch.linalg.cross(up, up.new_tensor([0.0, 1.0, 0.0])))
    return torch.eye(3).to(up) + cross + cross @ cross / (1.0 + up[1])


def left_jacobian(vectors: Tensor) -> Tensor:
    """How a rotation turns, in its own axes after it, as its vector (N, 3) changes; (N, 3, 3)."""
    angle = vectors.norm(dim=-1)[:, None, None]
    small, square = angle < _SHORT, angle.square()
    safe = torch.where(small, torch.ones_like(angle), angle)
    first = torch.where(small, 0.5 - square / 24, (1 - safe.cos()) / safe.square())
    second = torch.where(small, 1 / 6 - square / 120, (safe - safe.sin()) / safe**3)
    turn = skew(vectors)
    return torch.eye(3).to(vectors) + first * turn + second * turn @ turn


def aligned(quaternions: Tensor) -> Tensor:
    """Quaternions along a curve (*b, F, 4) with signs chosen so that neighbours agree.

    The first keeps its sign. This makes a quaternion a smooth function of time through any number
    of full turns, where rotation vectors and Euler angles jump.
    """
    agreement = (quaternions[..., 1:, :] * quaternions[..., :-1, :]).sum(-1, keepdim=True)
    flips = torch.where(agreement < 0, -1.0, 1.0).to(quaternions.dtype).cumprod(-2)
    return torch.cat((quaternions[..., :1, :], flips * quaternions[..., 1:, :]), -2)


# --- Weighted means of rotations, and rotation vectors that run past a half turn ------------------

# Three rotations and more: a step shrinks the error by about a twelfth of the squared spread.
MEAN_STEPS = 12
FULL_TURN = 2 * torch.pi  # rad


def rotation_mean(rotvecs: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean of rotations that does not depend on which vector stands for them.

    For two rotations this is spherical interpolation along the shorter arc; for more, the
    rotation that minimises the weighted sum of squared angles (Karcher's mean, by fixed-point
    iteration from the first). Vectors that differ by full turns, or by sign at a half turn, are
    one rotation. The result is the vector nearest the first one, so that trajectories which run
    past a half turn keep doing so. Where all vectors are equal they are returned to the last bit.

    Two rotations half a turn apart have two shorter arcs; one of them is taken.

    Args:
        rotvecs: rotation vectors (*b, M, 3), radians; put the one of largest weight first.
        weights: (*b, M), summing to one over M.

    Returns:
        Rotation vectors (*b, 3), radians.
    """
    first = rotvecs[..., 0, :]
    weights = weights.to(rotvecs.dtype).unsqueeze(-1)
    linear = first + (weights * (rotvecs - rotvecs[..., :1, :])).sum(-2)
    if rotvecs.shape[-2] == 1:
        return first
    quaternions = rotvec_to_quaternion(rotvecs)
    mean = quaternions[..., 0, :]
    for _ in range(1 if rotvecs.shape[-2] == 2 else MEAN_STEPS):
        apart = quaternion_multiply(_conjugate(mean).unsqueeze(-2), quaternions)
        step = (weights * quaternion_to_rotvec(apart)).sum(-2)
        mean = quaternion_multiply(mean, rotvec_to_quaternion(step))
    curved = nearest_turn(quaternion_to_rotvec(mean), first)
    # equal vectors: the linear mean has the same value and the same derivative, without rounding
    equal = (rotvecs == rotvecs[..., :1, :]).all(-1).all(-1)
    return torch.where(equal.unsqueeze(-1), linear, curved)


def nearest_turn(rotvec: Tensor, reference: Tensor) -> Tensor:
    """The vector of the same rotation that is nearest a reference: full turns are added.

    Args:
        rotvec: (*b, 3), radians. Where it is zero it has no axis, and the turns are about the
            reference's.
        reference: (*b, 3), radians.

    Returns:
        (*b, 3), radians, differentiable in ``rotvec``.
    """
    squared = rotvec.square().sum(-1, keepdim=True)
    still = squared < torch.finfo(rotvec.dtype).eps
    turning = rotvec / torch.where(still, torch.ones_like(squared), squared).sqrt()
    axis = torch.where(still, torch.nn.functional.normalize(reference.detach(), dim=-1), turning)
    along = ((reference - rotvec) * axis).sum(-1, keepdim=True).detach()
    return rotvec + FULL_TURN * (along / FULL_TURN).round() * axis


def unwrapped(rotvecs: Tensor) -> Tensor:
    """Rotation vectors over time (*b, F, 3) without jumps of full turns, the first one kept.

    Each is the nearest to the one before. A curve that passes close by the identity after a full
    turn has no continuous rotation vector; there it still jumps.
    """
    curve = [rotvecs[..., 0, :]]
    for rotvec in rotvecs.unbind(-2)[1:]:
        curve.append(nearest_turn(rotvec, curve[-1]))
    return torch.stack(curve, -2)


def _conjugate(quaternion: Tensor) -> Tensor:
    return torch.cat((quaternion[..., :1], -quaternion[..., 1:]), -1)
