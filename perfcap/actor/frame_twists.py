"""How the unknowns of a frame move the joints: as screws, instantaneous rigid motions.

A twist (w, v) gives the point p the velocity ``w x p + v``: v is the velocity of the material
point at the world's origin. An unknown moves all joints that it moves at all by the same twist.
"""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.kinematic_tree import KinematicTree
from perfcap.geometry.rotation import skew


def frame_twists(tree: KinematicTree, rotation: Tensor, position: Tensor, angles: Tensor) -> Tensor:
    """Twists of a frame's unknowns (translation, rotation, angles), then of the clavicles' turns.

    Angles move what a clavicle carries through its turn as well, which their twists hold; how they
    move the clavicles themselves is left to ``ClavicleTurns.fold``.

    Args:
        tree: of the skeleton.
        rotation: of its joints, rest to posed, (*b, F, J, 3, 3).
        position: of its joints in the world, (*b, F, J, 3), metres.
        angles: where they are, (*b, F, A), radians.

    Returns:
        (*b, F, 6 + A + K, 6).
    """
    axes = _hinge_axes(tree, rotation, angles)
    world = torch.eye(3).to(axes).expand(*axes.shape[:-2], 3, 3)
    turn = torch.cat((world, axes), -2)
    joint = torch.cat((tree.hinge_joint.new_zeros(3), tree.hinge_joint))
    velocity = torch.linalg.cross(position[..., joint, :], turn)
    shift = torch.cat((torch.zeros_like(world), world), -1)
    if not tree.clavicles.count:
        return torch.cat((shift, torch.cat((turn, velocity), -1)), -2)
    drifts = tree.clavicles.drifts(rotation, position, angles)
    velocity = velocity + torch.nn.functional.pad(drifts, (0, 0, 3, 0))
    own = tree.clavicles.arms(rotation, position)[0]
    own = torch.cat((own, torch.linalg.cross(position[..., tree.clavicles.joint, :], own)), -1)
    return torch.cat((shift, torch.cat((turn, velocity), -1), own), -2)


def topmost_joints(tree: KinematicTree) -> Tensor:
    """The topmost joint that each twist of a frame moves, (6 + A + K,)."""
    return torch.cat((tree.hinge_joint.new_zeros(6), tree.hinge_joint, tree.clavicles.joint))


def moved_joints(tree: KinematicTree) -> Tensor:
    """1 where a twist moves a joint, else 0, (J, 6 + A + K)."""
    return tree.above[:, topmost_joints(tree)]


def _hinge_axes(tree: KinematicTree, rotation: Tensor, angles: Tensor) -> Tensor:
    """Axes of the hinges in the world, (*b, F, A, 3), given the joints' (*b, F, J, 3, 3).

    A hinge's own turn keeps its axis, so the axes are found by undoing a joint's hinges from the
    last to the first.
    """
    turn = skew(torch.cat((tree.axes, tree.axes.new_zeros(1, 3))))  # none where slots are padded
    angles = torch.cat((angles, torch.zeros_like(angles[..., :1])), -1)[..., None, None]
    undo = torch.eye(3).to(turn) - angles.sin() * turn + (1 - angles.cos()) * (turn @ turn)
    axes = torch.cat((tree.axes, tree.axes.new_zeros(1, 3)))[..., None]
    body, world = rotation @ tree.unrest.mT, []
    for slot in reversed(tree.slots.unbind(-1)):
        world.append((body @ axes[slot]).squeeze(-1))  # *b F J 3
        body = body @ undo[..., slot, :, :]
    joint = tree.hinge_joint
    place = (tree.slots[joint] == torch.arange(len(joint)).to(joint)[:, None]).long().argmax(-1)
    return torch.stack(world[::-1], -2)[..., joint, place, :]
