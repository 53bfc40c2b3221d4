"""Frames solved on their own: windows of one frame, all at once."""

from __future__ import annotations

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
    single = detections.map(lambda each: each[:, None])
    objective = pose_objective(actor, cameras.apart(), single, config, pixel_unit, trajectory=None)
    initial = start.map(lambda each: each[:, None])
    method = LevenbergMarquardt(config.initial_steps, tolerance=config.initial_tolerance)
    solution = solve(objective, initial, method, angle_bounds(actor))
    state: Motion = solution.state
    return state.map(lambda each: each[:, 0]), solution.energy
