"""Robots out of the floor: no vertex of a foot stays below, and nothing else changes."""

from dataclasses import replace
from pathlib import Path

import robots
import torch

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.io.robot import load_robot
from perfcap.pipeline.robot_feet import above_floor, grounded

F64 = torch.float64
FRAMES = 40


def sinking(actor: Actor) -> Motion:
    """Feet on the floor, but a dip of 3 cm and a roll of the feet in some frames."""
    motion = grounded(actor, actor.skeleton.rest_motion(FRAMES))
    place = motion.translation.clone()
    place[20:23, 1] -= 0.03
    angles = motion.angles.clone()
    angles[30, list(actor.skeleton.angle_names).index("left_ankle_roll")] = 0.4
    return replace(motion, translation=place, angles=angles)


def lowest(actor: Actor, motion: Motion) -> torch.Tensor:
    return actor.surface(motion)[..., 1].amin(-1)  # the feet are the robot's only shapes


def test_feet_come_out_smoothly(tmp_path: Path) -> None:
    actor = load_robot(robots.write(tmp_path)["xml"])
    motion = sinking(actor)
    assert lowest(actor, motion).min() < -0.015
    found = above_floor(actor, motion, 30.0)
    assert lowest(actor, found).min() >= -0.004 - 1e-9
    lift = (found.translation - motion.translation)[:, 1]
    assert (lift >= 0).all() and lift[:8].abs().max() == 0 and lift.max() < 0.04
    assert lift.diff().abs().max() < 0.02  # comes and goes over several frames
    assert torch.equal(found.angles, motion.angles)
    assert torch.equal(found.translation[:, ::2], motion.translation[:, ::2])


def test_what_stands_stays(tmp_path: Path) -> None:
    actor = load_robot(robots.write(tmp_path)["urdf"])
    motion = grounded(actor, actor.skeleton.rest_motion(5))
    assert lowest(actor, motion).abs().max() < 1e-9
    assert above_floor(actor, motion, 30.0) is motion
