"""Angles of joints from their rotations, in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.skeleton import Skeleton
from perfcap.geometry.rotation import rotvec_to_matrix

_ROUNDS = 8  # of hinges that are not square: ankles are within 1e-6 degrees after seven


@torch.no_grad()
def joint_angles(skeleton: Skeleton, rotation: Tensor) -> Tensor:
    """Angles, within their limits, under which joints turn nearly as given.

    Three hinges square to one another can make any rotation, of which one of two sets of angles is
    taken: the one nearer to the limits. Fewer hinges make the nearest they can.
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
    """Angles (F, K) about axes (K, 3) whose product is nearest to ``turned`` (F, 3, 3).

    Each in turn is the best for what the others leave, until they agree.
    """
    found = [turned.new_zeros(len(turned))] * len(axes)
    for _ in range(_ROUNDS if len(axes) > 1 else 1):
        for slot, axis in enumerate(axes):
            left = turned
            for angle, other in zip(found[:slot], axes[:slot], strict=True):
                left = rotvec_to_matrix(angle[:, None] * other).mT @ left
            for angle, other in zip(found[:slot:-1], axes.flip(0)[: -slot - 1], strict=True):
                left = left @ rotvec_to_matrix(angle[:, None] * other).mT
            found[slot] = _nearest(axis, left)
    return torch.stack(found, -1)


def _nearest(axis: Tensor, turned: Tensor) -> Tensor:
    """Angle (F,) about an axis (3,) nearest to R: atan2(a . vee(R - R'), tr R - a' R a)."""
    vee = torch.stack((turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0],
                       turned[:, 1, 0] - turned[:, 0, 1]), -1)  # fmt: skip
    trace = turned.diagonal(dim1=-2, dim2=-1).sum(-1)
    return torch.atan2(vee @ axis, trace - (turned @ axis) @ axis)


def _wrapped(angles: Tensor, centre: Tensor) -> Tensor:
    """Angles moved by full turns to within half a turn of the middle of their limits."""
    return angles - 2 * math.pi * ((angles - centre) / (2 * math.pi)).round()


# --------------------------------------------------------------------------------------------------
# Joints and their axes as landmarks: what shows how a joint is turned, not only where it is.

AXES = 3


def axes_skeleton(skeleton: Skeleton) -> Skeleton:
    """The skeleton with 4 J more landmarks behind its own: every joint, then a metre along each
    axis of the world of the rest pose, turning with the joint.

    Differences of the last three and the first are the columns of the joint's rotation, so that
    energies of points see orientations without a chart, and so without its poles.
    """
    rig = skeleton.rig
    names, joints, places = [], [], []
    corners = torch.cat((torch.zeros(1, AXES), torch.eye(AXES))).to(rig.positions)
    for number, joint in enumerate(rig.joints):
        names += [joint + "_origin", *(f"{joint}_{axis}" for axis in "xyz")]
        joints += [number] * (1 + AXES)
        places.append(rig.positions[number] + corners)
    groups = rig.bone_groups
    more = [groups[joint] for joint in joints] if groups else []
    wider = replace(
        rig,
        landmarks=(*rig.landmarks, *names),
        landmark_joints=(*rig.landmark_joints, *joints),
        landmark_positions=torch.cat((rig.landmark_positions, torch.cat(places))),
        bone_groups=(*groups, *more),
    )
    return Skeleton(wider).to(skeleton.lower)


def origin_row(skeleton: Skeleton, joint: str) -> int:
    """Row of a joint's place among the landmarks of an ``axes_skeleton``; its axes follow."""
    rig = skeleton.rig
    return len(rig.landmarks) - (1 + AXES) * len(rig.joints) + (1 + AXES) * rig.joints.index(joint)
