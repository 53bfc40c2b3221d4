"""Second derivatives of landmarks in closed form.

An unknown a turns everything below it about its axis, so where a comes before b on the way from
the root, the derivative of a landmark in b, J_b, turns too: d2p / da db = axis_a x J_b. Contracted
with a pull w on the landmarks, that is ``axis_a . sum_l J_b,l x w_l``: one vector for each b.
"""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.frame_twists import frame_twists, moved_joints
from perfcap.actor.kinematic_tree import Pose
from perfcap.actor.motion import BONES, Motion
from perfcap.actor.skeleton import Skeleton

Blocks = tuple[Tensor, Tensor | None, Tensor | None]


def kinematic_curvature(
    skeleton: Skeleton, motion: Motion, jacobian: Tensor, pull: Tensor
) -> Blocks:
    """Second derivative of ``<pull, landmarks>`` in the tangent of a motion.

    Args:
        skeleton: whose landmarks.
        motion: where, (*b, F).
        jacobian: derivative of the landmarks in a frame's unknowns, (*b, F, L, 3, 6 + A).
        pull: on the landmarks, (*b, F, L, 3).

    Returns:
        In the frame's unknowns (*b, F, 6 + A, 6 + A), in those and the bones (*b, F, 6 + A, S),
        and in the bones, summed over frames (*b, S, S); the last two None where bones are known.
    """
    tree, pose = skeleton.tree, skeleton(motion)
    twists = frame_twists(tree, pose.rotation, pose.position, motion.angles)
    axes = twists[..., 3 : motion.frame_dim, :3]  # *b F 3+A 3
    moment = torch.linalg.cross(jacobian[..., 3:].mT, pull.unsqueeze(-2)).sum(-3)  # *b F 3+A 3
    turned = _order(skeleton) * (axes @ moment.mT)
    frame = torch.nn.functional.pad(turned + turned.mT, (3, 0, 3, 0))
    carried = tree.chain[tree.joints :].mT @ pull  # what pulls on a bone's end, *b F J+L 3
    if tree.clavicles.count:
        clavicles = _through_clavicles(skeleton, motion, pose, axes[..., 3:, :], carried)
        frame = frame + torch.nn.functional.pad(clavicles, (6, 0, 6, 0))
    if BONES not in motion.shared:
        return frame, None, None
    vectors = tree.scaled_bones(motion.shared[BONES]).unsqueeze(-3)
    bones = (pose.rotation[..., tree.bone_start, :, :] @ vectors[..., None]).squeeze(-1)
    groups = torch.arange(len(tree.group_names)).to(tree.bone_group)
    member = (tree.bone_group[:, None] == groups).to(bones)  # J+L S
    below = moved_joints(tree)[tree.bone_start, 3 : motion.frame_dim].mT.to(bones)  # 3+A J+L
    torque = axes @ torch.linalg.cross(bones, carried).mT  # *b F 3+A J+L
    border = torch.nn.functional.pad((below * torque) @ member, (0, 0, 3, 0))
    if tree.clavicles.count:
        ends, every = tree.clavicles.carried, tree.clavicles
        along, arm = every.arms(pose.rotation, pose.position)
        pulled = (torch.linalg.cross(along, arm) * carried[..., ends, :]).sum(-1, keepdim=True)
        more = torch.einsum("...ki,kia->...ak", every.slopes(motion.angles) * pulled, every.spread)
        border = border + torch.nn.functional.pad(more @ member[ends], (0, 0, 6, 0))
    stretched = (bones * carried).sum(-1).sum(-2) @ member
    return frame, border, torch.diag_embed(stretched)


def _through_clavicles(
    skeleton: Skeleton, motion: Motion, pose: Pose, axes: Tensor, carried: Tensor
) -> Tensor:
    """What the turns of clavicles add to the second derivative in the angles, (*b, F, A, A).

    What an arm carries is shifted by ``m = axis x clavicle`` a radian. In its two angles the second
    derivative of that is ``turn'_i turn'_j axis x m + turn''_ij m``; the rule of hinges has put
    ``axis_i x turn'_j m`` in its place.
    """
    every = skeleton.tree.clavicles
    along, arm = every.arms(pose.rotation, pose.position)
    shift, pull = torch.linalg.cross(along, arm), carried[..., every.carried, :]
    slopes = every.slopes(motion.angles)  # *b F K 2
    bent = (torch.linalg.cross(along, shift) * pull).sum(-1)[..., None, None]
    straight = (shift * pull).sum(-1)[..., None, None]
    block = slopes[..., :, None] * slopes[..., None, :] * bent
    block = block + every.curvatures(motion.angles) * straight
    lifted = torch.linalg.cross(axes[..., every.lifts, :], shift.unsqueeze(-2))
    taken = (lifted * pull.unsqueeze(-2)).sum(-1)  # *b F K 2
    first, last = taken[..., 0] * slopes[..., 0], taken[..., 1] * slopes[..., 1]
    mixed = taken[..., 0] * slopes[..., 1]
    block = block - torch.stack((first, mixed, mixed, last), -1).reshape(block.shape)
    return torch.einsum("...kij,kia,kjb->...ab", block, every.spread, every.spread)


def _order(skeleton: Skeleton) -> Tensor:
    """1 where an unknown comes before another, 1/2 where they turn as one, (3 + A, 3 + A).

    With its transpose added every pair counts once, and the root rotation, which turns about all
    three axes at once, is the mean of both orders.
    """
    tree = skeleton.tree
    joint = tree.hinge_joint
    count = len(joint)
    before = moved_joints(tree)[joint, 6 : 6 + count].mT.clone()  # of hinges, by first, then second
    index = torch.arange(count).to(joint)
    same = joint[:, None] == joint
    before[same] = (index[:, None] < index)[same].to(before)
    before = before + 0.5 * torch.eye(count).to(before)
    order = before.new_ones(3 + count, 3 + count)
    order[:3, :3], order[3:, :3], order[3:, 3:] = 0.5, 0.0, before
    return order
