"""People of one source in one level world, before and after they are put on other characters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.rotation import turn_to_y
from perfcap.io.moving_rig import Floats, MovingRig
from perfcap.pipeline.joint_motion import JointMotion, carried_landmarks
from perfcap.pipeline.retargeting import Retargeted
from perfcap.pipeline.surroundings import shared_up, upright

_STAGE = 0.25  # m, above the lowest floor; less is how well floors are found


def level_rigs(rigs: Sequence[MovingRig]) -> list[MovingRig]:
    """The same with y up in their world: all people of a capture are turned and moved alike."""
    if all(rig.level for rig in rigs):
        return list(rigs)
    people = [_landmarks(rig) for rig in rigs]
    ways = [rig.world_to_floor for rig in rigs]
    known = [way for way in ways if way is not None]
    known = known or [_upright_way(joints) for joints in people]
    ups = [torch.tensor(way[1, :3]) for way in known]
    matrix = known[shared_up(people, ups)]
    turn = matrix[:3, :3]
    return [
        replace(
            rig,
            rotation=turn @ rig.rotation,
            position=rig.position @ turn.T + matrix[:3, 3],
            level=True,
        )
        for rig in rigs
    ]


def part_of(whole: MovingRig, part: MovingRig) -> MovingRig:
    """A part in the world of all of it, with what was said of the part."""
    chosen = np.isin(whole.frames, part.frames)
    return replace(
        whole,
        rotation=whole.rotation[chosen],
        position=whole.position[chosen],
        frames=whole.frames[chosen],
        notes=part.notes,
        about=part.about,
    )


def joints_of(rig: MovingRig) -> JointMotion:
    """The motion of a person's joints, as ``retarget`` takes it."""
    return JointMotion(torch.tensor(rig.rotation), torch.tensor(rig.position))


def _landmarks(rig: MovingRig) -> Tensor:
    joints = joints_of(rig)
    return carried_landmarks(rig.actor.skeleton, joints)[:, : len(LANDMARKS)]


def _upright_way(landmarks: Tensor) -> Floats:
    """Turns a world, as (4, 4), so that a person of landmarks (F, 16, 3) stands along y."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn_to_y(upright(landmarks)).numpy()
    return matrix


def on_their_floors(people: Sequence[tuple[Retargeted, Actor]]) -> list[Retargeted]:
    """The same with y = 0 where the lowest of the floors is that were found.

    Each is on y = 0 by itself; whoever stands on a stage beside others is to stay above them.

    Args:
        people: what was found, and on which character.
    """
    known = [found.lowered for found, _ in people if found.lowered is not None]
    lowest = min(known, default=0.0)
    placed = []
    for found, target in people:
        raised = (found.lowered or 0.0) - lowest
        grounded = found.lowered is None and bool(target.skeleton.rig.roles)  # a robot
        placed.append(found if raised < _STAGE or grounded else _raised(found, raised))
    return placed


def _raised(found: Retargeted, height: float) -> Retargeted:
    up = found.motion.translation.new_tensor([0.0, height, 0.0])
    floor = found.floor and replace(found.floor, height=found.floor.height + height)
    motion = replace(found.motion, translation=found.motion.translation + up)
    return replace(found, motion=motion, floor=floor)
