"""Points under the feet of an actor, as landmarks that move with its skeleton."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.rig import Rig
from perfcap.actor.skeleton import Skeleton

SIDES = ("left", "right")
SOLE_POINTS = ("heel", "inner_ball", "outer_ball", "tip")
_OWNED = 0.25  # least weight of the ankle for a vertex to be part of the foot
_ENOUGH = 8  # vertices of a foot from which its sole can be read
_THICK = 0.02  # m, of the layer of vertices that are the sole
_BELOW = 0.025  # m, from a toe's joint to the ground, where there is no mesh
_BEHIND = 0.05  # m, from the ankle to the end of the heel, likewise
_HALF_WIDTH = 0.04  # m, of the ball, likewise
_BALL = 0.7  # where the ball is, from the heel to the tip


def sole_skeleton(actor: Actor) -> Skeleton:
    """The actor's skeleton with eight more landmarks behind its own: four under each foot.

    Heel, both ends of the ball and tip, of the left foot, then of the right; rigid with the ankle.
    They lie in one horizontal plane in the rest pose, through the lowest vertices of the foot;
    without a mesh (an actor of joints alone) a shoe is assumed around ankle and toe.

    Args:
        actor: whose feet; y is up in its rest pose.

    Returns:
        A skeleton that poses and linearises them: ``skeleton(motion).landmarks[..., -8:, :]``.
    """
    rig = actor.skeleton.rig
    groups = rig.bone_groups
    names, joints, places = [], [], []
    for side in SIDES:
        ankle = _ankle(rig, side[0])
        names += [f"{side[0]}_{point}" for point in SOLE_POINTS]
        joints += [ankle] * len(SOLE_POINTS)
        places.append(_sole(actor, rig, side[0]))
    toe = [rig.landmarks.index(f"{side[0]}_toe") for side in SIDES]
    more = [groups[len(rig.joints) + t] for t in toe for _ in SOLE_POINTS] if groups else []
    own = rig.landmark_positions
    wider = replace(
        rig,
        landmarks=(*rig.landmarks, *names),
        landmark_joints=(*rig.landmark_joints, *joints),
        landmark_positions=torch.cat((own, torch.cat(places).to(own))),
        bone_groups=(*groups, *more),
    )
    return Skeleton(wider).to(actor.skeleton.lower)


def _sole(actor: Actor, rig: Rig, side: str) -> Tensor:
    """Rest positions of the points of a foot, (4, 3)."""
    ankle = rig.positions[_ankle(rig, side)]
    toe = rig.landmark_positions[rig.landmarks.index(f"{side}_toe")].to(ankle)
    vertices = _foot_vertices(actor, _ankle(rig, side))
    if rig.neutral is None:
        return _flat_sole(ankle, toe, vertices, side)
    # a robot's foot may be drawn lifted or rolled: its sole is read as it stands
    turn = rig.neutral[JOINTS.index(f"{side}_ankle")].to(ankle)
    standing = (vertices - ankle) @ turn.mT + ankle
    return (_flat_sole(ankle, turn @ (toe - ankle) + ankle, standing, side) - ankle) @ turn + ankle


def _flat_sole(ankle: Tensor, toe: Tensor, vertices: Tensor, side: str) -> Tensor:
    """Points of a foot (4, 3) that stands on the ground."""
    along = (toe - ankle) * toe.new_tensor([1.0, 0.0, 1.0])
    along = along / along.norm().clamp(min=1e-9)
    inward = 1.0 if side == "r" else -1.0  # the left is at +x
    across = inward * torch.linalg.cross(along.new_tensor([0.0, 1.0, 0.0]), along)
    if len(vertices) >= _ENOUGH:
        ground = vertices[:, 1].min()
        near = vertices[vertices[:, 1] < ground + _THICK] - ankle
        forward = near @ along
        back, front = float(forward.min()), float(forward.max())
        ball = back + _BALL * (front - back)
        beside = near[(forward - ball).abs() < 0.25 * max(front - back, 1e-3)] @ across
        ends = (0.0, float(beside.max()), float(beside.min()), 0.0) if len(beside) else _ENDS
    else:
        ground = torch.minimum(toe[1] - _BELOW, ankle[1] - _BELOW)
        back, front = -_BEHIND, float((toe - ankle) @ along)
        ball, ends = front, _ENDS
    points = [
        ankle + forward * along + sideways * across
        for forward, sideways in zip((back, ball, ball, front), ends, strict=True)
    ]
    sole = torch.stack(points)
    sole[:, 1] = ground
    return sole


_ENDS = (0.0, _HALF_WIDTH, -_HALF_WIDTH, 0.0)


def _ankle(rig: Rig, side: str) -> int:
    """The joint that carries a toe; a robot calls it something else."""
    return rig.landmark_joints[rig.landmarks.index(f"{side}_toe")]


def _foot_vertices(actor: Actor, ankle: int) -> Tensor:
    """Rest vertices that mostly move with an ankle and what hangs on it, such as the toes of a
    robot, (N, 3); none of an actor without a mesh.
    """
    if getattr(actor, "skin", None) is None:
        return torch.zeros(0, 3)
    bones, weights, _ = actor.skin.rows()
    foot = [ankle]
    for joint, parent in enumerate(actor.skeleton.rig.parents):
        foot += [joint] if parent in foot else []
    owned = torch.where(torch.isin(bones, bones.new_tensor(foot)), weights, 0).sum(-1) > _OWNED
    return actor.vertices[owned].to(actor.skeleton.rig.positions)
