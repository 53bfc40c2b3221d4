"""Angles of joints from their rotations, in closed form."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.actor.skeleton import Skeleton
from perfcap.geometry.rotation import rotvec_to_matrix


@torch.no_grad()
def joint_angles(skeleton: Skeleton, rotation: Tensor) -> Tensor:
    """Angles, within their limits, under which joints turn nearly as given.

    Three hinges square to one another can make any rotation, of which one of two sets of angles is
    taken: the one nearer to the limits. Fewer hinges make the nearest they can one after another.
    A start for a solve, which weighs joints against one another.

    Args:
        skeleton: whose joints.
        rotation: rest-to-posed rotations in the world, (F, J, 3, 3); those of the last joints, as
            of clavicles, which have no angles, may be left out.

    Returns:
        (F, A), radians.
    """
    tree = skeleton.tree
    given = rotation.shape[1]
    parents = tree.parents[:given].clamp(min=0)
    turned = rotation[:, parents].mT @ rotation @ tree.unrest[:given].mT  # products of hinges
    angles = skeleton.rest_angles.to(rotation).expand(len(rotation), -1).clone()
    for joint in range(given):
        hinges = [int(slot) for slot in tree.slots[joint] if slot < len(tree.axes)]
        if not hinges:
            continue
        axes, own = tree.axes[hinges].to(rotation), turned[:, joint]
        limits = skeleton.lower[hinges].to(rotation), skeleton.upper[hinges].to(rotation)
        found = _three(axes, own, *limits) if len(hinges) == 3 else _few(axes, own)
        angles[:, hinges] = found
    return angles.clamp(skeleton.lower.to(angles), skeleton.upper.to(angles))


def _three(axes: Tensor, turned: Tensor, lower: Tensor, upper: Tensor) -> Tensor:
    """Angles (F, 3) about three square axes (3, 3) whose product is ``turned`` (F, 3, 3)."""
    handed = 1.0 if float(torch.linalg.det(axes)) > 0 else -1.0
    basis = axes.mT * axes.new_tensor([1.0, 1.0, handed])
    r = basis.mT @ turned @ basis  # Rx(a) Ry(b) Rz(c)
    middle = r[:, 0, 2].clamp(-1, 1).asin()
    first = torch.atan2(-r[:, 1, 2], r[:, 2, 2])
    last = torch.atan2(-r[:, 0, 1], r[:, 0, 0])
    sign = axes.new_tensor([1.0, 1.0, handed])
    one = sign * torch.stack((first, middle, last), -1)
    two = sign * torch.stack((first + math.pi, math.pi - middle, last + math.pi), -1)
    centre = 0.5 * (lower + upper)
    both = torch.stack([_wrapped(each, centre) for each in (one, two)])
    beyond = (both - both.clamp(lower, upper)).abs().sum(-1)
    return torch.where((beyond[0] <= beyond[1])[:, None], both[0], both[1])


def _few(axes: Tensor, turned: Tensor) -> Tensor:
    """Angles (F, K) about axes (K, 3), each the best for what those before it have left."""
    found = []
    for axis in axes:
        # the turn about a is nearest to R where the angle is atan2(a . vee(R - R'), tr R - a' R a)
        vee = torch.stack((turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0],
                           turned[:, 1, 0] - turned[:, 0, 1]), -1)  # fmt: skip
        trace = turned.diagonal(dim1=-2, dim2=-1).sum(-1)
        angle = torch.atan2(vee @ axis, trace - (turned @ axis) @ axis)
        found.append(angle)
        turned = rotvec_to_matrix(angle[:, None] * axis).mT @ turned
    return torch.stack(found, -1)


def _wrapped(angles: Tensor, centre: Tensor) -> Tensor:
    """Angles moved by full turns to within half a turn of the middle of their limits."""
    return angles - 2 * math.pi * ((angles - centre) / (2 * math.pi)).round()
