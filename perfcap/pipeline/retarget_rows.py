"""What a retargeted pose is asked for: vectors between joints, and the axes of joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.joint_angles import AXES, axes_skeleton, origin_row
from perfcap.actor.motion import Motion
from perfcap.actor.points import Landmarks, PointDifferences
from perfcap.actor.skeleton import Skeleton
from perfcap.energy.joint_target import JointTarget
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.joint_motion import (
    ARMS,
    LIMBS,
    JointMotion,
    arm_length,
    person_joints,
    unit_vectors,
    wanted_turns,
)


@dataclass(frozen=True)
class Rows:
    """What poses are asked for: vectors of the target that should equal given ones.

    Attributes:
        points: the vectors, M.
        aim: what they should be, (F, M, 3), metres.
        sure: how much each counts, (F, M).
        unit: deviations, (M,), metres.
    """

    points: PointDifferences
    aim: Tensor
    sure: Tensor
    unit: Tensor

    def energy(self, index: Tensor) -> JointTarget:
        """Of frames (N, W)."""
        aim, sure = self.aim[index].unsqueeze(-3), self.sure[index].unsqueeze(-2)
        return JointTarget(self.points, aim, sure, unit=self.unit)

    @classmethod
    def of(
        cls,
        source: Actor,
        joints: JointMotion,
        target: Actor,
        begun: Motion,
        config: RetargetConfig,
    ) -> Rows:
        """Rows of orientations, limbs, reaches and the root."""
        skeleton = axes_skeleton(target.skeleton)
        wanted = wanted_turns(source, joints, target.skeleton)
        place = joints.position.to(wanted)
        rows = _RowList(skeleton)
        for joint, deviation in config.turns.items():
            for axis in range(AXES):
                aim = wanted[:, JOINTS.index(joint), :, axis]
                rows.add(rows.row(joint) + 1 + axis, joint, aim, math.radians(deviation))
        for start, end in LIMBS:
            length = rows.rest(start, end)
            aim = length * unit_vectors(place[:, JOINTS.index(end)] - place[:, JOINTS.index(start)])
            rows.add(rows.row(end), start, aim, math.radians(config.limbs) * length)
        ratio = arm_length(target.skeleton) / arm_length(source.skeleton)
        for start, end in ARMS:
            reach = place[:, JOINTS.index(end)] - place[:, JOINTS.index(start)]
            rows.add(rows.row(end), start, ratio * reach, config.reach)
        apart = place[:, JOINTS.index("l_wrist")] - place[:, JOINTS.index("r_wrist")]
        near = (1 + (apart.norm(dim=-1) / config.near).square()).square().reciprocal()
        rows.add(rows.row("l_wrist"), "r_wrist", ratio * apart, config.together, near)
        hips = begun.translation
        if target.skeleton.rig.roles:  # whose root may be the chest
            hips = target.skeleton(begun).position[:, person_joints(target.skeleton)[0]]
        rows.add(rows.row("pelvis"), None, hips, config.root)
        return rows.done()


class _RowList:
    """Rows as they are added."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton = skeleton
        self.ends: list[int] = []
        self.starts: list[int | None] = []
        self.aims: list[Tensor] = []
        self.sure: list[Tensor] = []
        self.units: list[float] = []

    def row(self, joint: str) -> int:
        """Of a person's joint; its axes follow."""
        rig = self.skeleton.rig
        return origin_row(
            self.skeleton, rig.joints[rig.roles[JOINTS.index(joint)]] if rig.roles else joint
        )

    def add(
        self, end: int, start: str | None, aim: Tensor, unit: float, sure: Tensor | None = None
    ) -> None:
        """The vector from a joint, or the world's origin, to a landmark should be (F, 3)."""
        self.ends.append(end)
        self.starts.append(None if start is None else self.row(start))
        self.aims.append(aim)
        self.sure.append(torch.ones_like(aim[:, 0]) if sure is None else sure)
        self.units.append(unit)

    def rest(self, start: str, end: str) -> float:
        """Length of a bone."""
        at = self.skeleton.rest_positions[person_joints(self.skeleton)]
        return float((at[JOINTS.index(end)] - at[JOINTS.index(start)]).norm())

    def done(self) -> Rows:
        """All of them."""
        points = PointDifferences(Landmarks(self.skeleton), self.ends, self.starts)
        aim = torch.stack(self.aims, 1)
        return Rows(
            points.to(aim.device), aim, torch.stack(self.sure, 1), aim.new_tensor(self.units)
        )
