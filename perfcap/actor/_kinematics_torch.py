"""Kinematics in plain torch: differentiable, on any device, and the oracle of the compiled twin."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.kinematic_tree import KinematicTree, Pose
from perfcap.actor.motion import BONES, Motion
from perfcap.geometry.rotation import rotvec_to_matrix, skew


def place(tree: KinematicTree, motion: Motion) -> Pose:
    """Posed joints and landmarks of a motion (*b, F)."""
    bodies = _turn_bodies(tree, motion, _joint_turns(tree, motion, _partial_turns(tree, motion)))
    return _place_points(tree, motion, bodies[..., 2:, :, :])[0]


def linearize(tree: KinematicTree, motion: Motion) -> tuple[Tensor, Tensor, Tensor | None]:
    """Landmarks and their derivatives; see ``Skeleton.linearize``."""
    partial = _partial_turns(tree, motion)
    bodies = _turn_bodies(tree, motion, _joint_turns(tree, motion, partial))
    pose, bones = _place_points(tree, motion, bodies[..., 2:, :, :])
    axes = _world_axes(tree, bodies, partial).unsqueeze(-3)  # *b F 1 A 3
    arms = pose.landmarks.unsqueeze(-2) - pose.position[..., tree.hinge_joint, :].unsqueeze(-3)
    turned = torch.linalg.cross(axes, arms * tree.moves[..., None])  # *b F L A 3
    if tree.clavicles.count:
        drifts = tree.clavicles.drifts(pose.rotation, pose.position, motion.angles)
        turned = turned + drifts.unsqueeze(-3) * tree.moves[..., None]
    root = skew(motion.translation.unsqueeze(-2) - pose.landmarks)  # columns e_k x (p - t)
    frame = torch.cat((torch.eye(3).to(root).expand_as(root), root, turned.mT), -1)
    return pose.landmarks, frame, _shape_jacobian(tree, bones) if BONES in motion.shared else None


def _partial_turns(tree: KinematicTree, motion: Motion) -> list[Tensor]:
    """Products of the first k hinges of each joint, (*b, F, J, 3, 3) for k = 0 ... K."""
    hinges = _turns(tree.axes, motion.angles)
    none = torch.eye(3).to(hinges).expand(*hinges.shape[:-3], 1, 3, 3)
    hinges = torch.cat((hinges, none), -3)[..., tree.slots, :, :]  # *b F J K 3 3
    partial = [none.expand(hinges[..., 0, :, :].shape)]
    for hinge in hinges.unbind(-3):
        partial.append(partial[-1] @ hinge)
    return partial


def _joint_turns(tree: KinematicTree, motion: Motion, partial: list[Tensor]) -> Tensor:
    """Rotation of each joint relative to its parent, (*b, F, J, 3, 3)."""
    turns = partial[-1] @ tree.unrest
    if not tree.clavicles.count:
        return turns
    clavicles = _turns(tree.clavicles.axes, tree.clavicles(motion.angles))
    source = torch.arange(tree.joints).to(tree.parents)
    source[tree.clavicles.joint] = tree.joints + torch.arange(tree.clavicles.count).to(source)
    return torch.cat((turns, clavicles), -3)[..., source, :, :]


def _turns(axes: Tensor, angles: Tensor) -> Tensor:
    """Rotations (*b, F, A, 3, 3) about axes (A, 3)."""
    turn = skew(axes)
    sine, cosine = angles.sin()[..., None, None], angles.cos()[..., None, None]
    return torch.eye(3).to(turn) + sine * turn + (1 - cosine) * (turn @ turn)


def _turn_bodies(tree: KinematicTree, motion: Motion, joint_turns: Tensor) -> Tensor:
    """Rest-to-posed rotation of the bodies of ``KinematicTree.jumps``, (*b, F, 2 + J, 3, 3)."""
    root = rotvec_to_matrix(motion.rotation).unsqueeze(-3)
    turns = torch.cat((torch.eye(3).to(root).expand_as(root), root, joint_turns), -3)
    for ancestors in tree.jumps:
        turns = turns[..., ancestors, :, :] @ turns
    return turns


def _place_points(tree: KinematicTree, motion: Motion, rotation: Tensor) -> tuple[Pose, Tensor]:
    """Joint and landmark positions, and the bones (*b, F, J + L, 3) in the world."""
    vectors = tree.scaled_bones(motion.shared.get(BONES))
    vectors = vectors.unsqueeze(-3) if BONES in motion.shared else vectors
    bones = (rotation[..., tree.bone_start, :, :] @ vectors[..., None]).squeeze(-1)
    points = tree.chain @ bones + motion.translation.unsqueeze(-2)
    position, landmarks = points.tensor_split((tree.joints,), -2)
    return Pose(rotation, position, landmarks), bones


def _world_axes(tree: KinematicTree, bodies: Tensor, partial: list[Tensor]) -> Tensor:
    """Axes of the hinges in the world, (*b, F, A, 3)."""
    joint = tree.hinge_joint
    slot = (tree.slots[joint] == torch.arange(len(joint)).to(joint)[:, None]).long().argmax(-1)
    before = torch.stack(partial[:-1], -3)[..., joint, slot, :, :]
    parents = bodies[..., tree.jumps[0, 2 + joint], :, :]
    return (parents @ (before @ tree.axes[..., None])).squeeze(-1)


def _shape_jacobian(tree: KinematicTree, bones: Tensor) -> Tensor:
    """Derivative of the landmarks in the log bone lengths, (*b, F, L, 3, S)."""
    groups = torch.arange(len(tree.group_names)).to(tree.bone_group)
    member = (tree.bone_group[:, None] == groups).to(bones)
    leads = tree.chain[tree.joints :, :, None] * member  # L J+L S
    return torch.einsum("lbs,...bi->...lis", leads, bones)
