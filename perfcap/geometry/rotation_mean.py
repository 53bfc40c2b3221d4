"""Weighted means of rotations, and rotation vectors that run past a half turn."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.geometry.rotation import (
    quaternion_multiply,
    quaternion_to_rotvec,
    rotvec_to_quaternion,
)

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
