"""A world of the program's own choice: y is up, and the floor that feet stand on at y = 0."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import compose_rotvec, matrix_to_rotvec
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.standing import Standing


def to_level(problem: ClipProblem) -> Tensor:
    """Rigid transform (4, 4) from the world of a solved problem, one camera's own, to a level one.

    Without a floor the camera is taken to be held level: its y points down.
    """
    if problem.standing is not None:
        return problem.standing.floor.world_to_floor()
    down = problem.pixel_unit.new_tensor([1.0, -1.0, -1.0, 1.0])
    return torch.diag(down)


def moved_problem(problem: ClipProblem, transform: Tensor) -> ClipProblem:
    """The same problem in a world that a rigid transform (4, 4) leads to."""
    if problem.targets is not None:
        raise ValueError("targets are places in the world; move the problem before they are given")
    standing = problem.standing
    return replace(
        problem,
        cameras=moved_cameras(problem.cameras, transform),
        standing=None if standing is None else _moved_standing(standing, transform),
    )


def moved_motion(motion: Motion, transform: Tensor) -> Motion:
    """The same motion after a rigid transform (4, 4) of the world."""
    turn, shift = transform[:3, :3], transform[:3, 3]
    step = matrix_to_rotvec(turn).expand_as(motion.rotation)
    return replace(
        motion,
        translation=motion.translation @ turn.mT + shift,
        rotation=compose_rotvec(step, motion.rotation),
    )


def moved_cameras(cameras: Camera, transform: Tensor) -> Camera:
    """Cameras that see in the world after a rigid transform (4, 4) what they saw before."""
    turn, shift = transform[:3, :3].to(cameras.rotation), transform[:3, 3].to(cameras.rotation)
    rotation = cameras.rotation @ turn.mT
    return replace(cameras, rotation=rotation, translation=cameras.translation - rotation @ shift)


def _moved_standing(standing: Standing, transform: Tensor) -> Standing:
    turn, shift = transform[:3, :3], transform[:3, 3]
    normal = turn @ standing.floor.normal
    return replace(
        standing,
        floor=replace(standing.floor, normal=normal, height=standing.floor.height + normal @ shift),
        place=standing.place @ turn.mT + shift,
        shift=standing.shift @ turn.mT,
    )
