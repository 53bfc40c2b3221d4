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
    if is_plain(left, right):
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


def aligned(quaternions: Tensor) -> Tensor:
    """Quaternions along a curve (*b, F, 4) with signs chosen so that neighbours agree.

    The first keeps its sign. This makes a quaternion a smooth function of time through any number
    of full turns, where rotation vectors and Euler angles jump.
    """
    agreement = (quaternions[..., 1:, :] * quaternions[..., :-1, :]).sum(-1, keepdim=True)
    flips = torch.where(agreement < 0, -1.0, 1.0).to(quaternions.dtype).cumprod(-2)
    return torch.cat((quaternions[..., :1, :], flips * quaternions[..., 1:, :]), -2)
