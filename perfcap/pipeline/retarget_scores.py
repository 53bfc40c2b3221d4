"""How much of a motion another skeleton has kept."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.metrics.contact import floor_contact, foot_skate
from perfcap.pipeline.joint_motion import (
    ARMS,
    LIMBS,
    JointMotion,
    arm_length,
    carried_landmarks,
    person_joints,
    unit_vectors,
)

if TYPE_CHECKING:
    from perfcap.pipeline.retargeting import Retargeted

_FEET = ("r_ankle", "r_toe", "l_ankle", "l_toe")
_ACROSS = (("r_hip", "l_hip"), ("r_shoulder", "l_shoulder"))
_UP = (0.0, 1.0, 0.0)
_MILLIMETRES = 1000.0


@dataclass(frozen=True)
class RetargetScores:
    """What was kept.

    Attributes:
        limbs: angles between limbs and the source's, (F, 8), degrees.
        facing: angles between the lines through hips and shoulders and the source's, (F, 2),
            degrees.
        trunk: angle between the way from the hips to the neck and the source's, (F,), degrees.
            Skeletons of recordings have necks up to 10 degrees behind.
        reach: of the wrists, as seen from the shoulders and in lengths of the arm, from the
            source's, (F, 2), mm.
        slide: mean way along the floor in a frame of feet that stand in the source, mm; NaN where
            none does.
        source_slide: the source's own, at the target's scale, mm.
    """

    limbs: Tensor
    facing: Tensor
    trunk: Tensor
    reach: Tensor
    slide: float
    source_slide: float

    def report(self) -> dict[str, Any]:
        """Medians and 95 % quantiles as plain values."""

        def two(values: Tensor) -> dict[str, float]:
            middle, most = values.flatten().quantile(values.new_tensor([0.5, 0.95])).tolist()
            return {"median": middle, "q95": most}

        return {
            "limbs_degrees": two(self.limbs),
            "facing_degrees": two(self.facing),
            "trunk_degrees": two(self.trunk),
            "reach_mm": two(self.reach),
            "slide_mm": None if math.isnan(self.slide) else self.slide,
            "source_slide_mm": None if math.isnan(self.source_slide) else self.source_slide,
        }


@torch.no_grad()
def retarget_scores(
    source: Actor, joints: JointMotion, target: Actor, found: Retargeted, rate: float
) -> RetargetScores:
    """Compare a retargeted motion with what it came from.

    Args:
        source: whose skeleton moved.
        joints: how, (F,), in a world with y up.
        target: who moves now.
        found: how.
        rate: frames a second.
    """
    pose = target.skeleton(found.motion)
    ours = pose.position[:, person_joints(target.skeleton)]
    theirs = joints.position.to(ours)
    ratio = arm_length(target.skeleton) / arm_length(source.skeleton)
    reach = (_reach(ours) - ratio * _reach(theirs)).norm(dim=-1)
    names = source.skeleton.rig.landmarks
    feet = [names.index(name) for name in _FEET]
    before = carried_landmarks(source.skeleton, joints)[:, feet]
    contact = floor_contact(before, before[..., 1], rate)
    up = before.new_tensor(_UP)
    # at the source's size: a character may be a giant, whose feet look like millimetres
    after = pose.landmarks[:, feet] / found.scale
    return RetargetScores(
        limbs=_apart(_between(ours, LIMBS), _between(theirs, LIMBS)),
        facing=_apart(_between(ours, _ACROSS), _between(theirs, _ACROSS)),
        trunk=_apart(_trunk(ours), _trunk(theirs)),
        reach=_MILLIMETRES * reach,
        slide=found.scale * float(foot_skate(after, contact, up)),
        source_slide=found.scale * float(foot_skate(before, contact, up)),
    )


def _apart(one: Tensor, other: Tensor) -> Tensor:
    """Angles between vectors (..., 3), degrees."""
    cosine = (unit_vectors(one) * unit_vectors(other)).sum(-1).clamp(-1, 1)
    return cosine.acos().rad2deg()


def _trunk(position: Tensor) -> Tensor:
    """From the middle of the hips to the neck, (F, 3)."""
    hips = [JOINTS.index(f"{side}_hip") for side in "lr"]
    return position[:, JOINTS.index("neck")] - position[:, hips].mean(1)


def _reach(position: Tensor) -> Tensor:
    return _between(position, ARMS)


def _between(position: Tensor, pairs: tuple[tuple[str, str], ...]) -> Tensor:
    starts, ends = ([JOINTS.index(name) for name in side] for side in zip(*pairs, strict=True))
    return position[:, ends] - position[:, starts]
