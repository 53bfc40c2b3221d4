"""Frames solved on their own: windows of one frame, all at once."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.objective import angle_bounds, pose_objective
from perfcap.solve import LevenbergMarquardt, solve


def solve_frames(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    config: PoseConfig,
    pixel_unit: Tensor,
    start: Motion,
) -> tuple[Motion, Tensor]:
    """Solve frames as a batch of one-frame windows; returns the motion (F,) and energies (F,)."""
    single = _single_frames(detections)
    objective = pose_objective(actor, cameras.apart(), single, config, pixel_unit, trajectory=None)
    initial = Motion(start.translation[:, None], start.rotation[:, None], start.angles[:, None])
    method = LevenbergMarquardt(config.initial_steps, tolerance=config.initial_tolerance)
    solution = solve(objective, initial, method, angle_bounds(actor))
    state: Motion = solution.state
    motion = Motion(state.translation[:, 0], state.rotation[:, 0], state.angles[:, 0])
    return motion, solution.energy


def chosen(better: Tensor, new: Motion, old: Motion) -> Motion:
    """Frames of ``new`` where ``better``, (F,) bool, and of ``old`` elsewhere."""
    where = better[:, None]
    return Motion(
        torch.where(where, new.translation, old.translation),
        torch.where(where, new.rotation, old.rotation),
        torch.where(where, new.angles, old.angles),
    )


def _single_frames(detections: Detections) -> Detections:
    joints3d = detections.joints3d
    return Detections(
        detections.joints2d[:, None],
        detections.confidence2d[:, None],
        None if joints3d is None else joints3d[:, None],
        detections.trusted3d[:, None],
    )
