"""Where the solve of an estimate begins: every frame of a clip on its own."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.energy.prior import PosePrior
from perfcap.energy.reprojection import Reprojection
from perfcap.pipeline.clip_problem import ClipProblem, targets_energy
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.gaps import fill_gaps
from perfcap.pipeline.initialize import initialize, joint_places, trunk_start
from perfcap.pipeline.jitter import relaxed
from perfcap.pipeline.objective import (
    angle_bounds,
    neutral_angles,
    person_height,
    pose_objective,
)
from perfcap.pipeline.pose_estimate import ClipEstimate
from perfcap.pipeline.prepare import prepare
from perfcap.solve import LevenbergMarquardt, Objective, solve

_FIT_POINTS = 3  # joints that fix a pose in space


@torch.no_grad()
def start_clip(
    actor: Actor, clip: ClipEstimate, config: PoseConfig, rate: float
) -> tuple[ClipProblem, Motion]:
    """The problem of a clip, and every frame of it solved on its own, (F,).

    Of the problem, detections, targets and cameras carry the graph of the estimate, nothing else.

    Raises:
        InputError: nobody is detected in the whole clip.
    """
    unit = 0.01 * person_height(clip.detections)
    relaxing = replace(clip.detections, joints3d=clip.targets) if clip.targets is not None else None
    calm = relaxed(config, relaxing or clip.detections, unit)
    problem = ClipProblem(
        actor,
        clip.cameras,
        clip.detections,
        config,
        unit,
        rate,
        clip.targets,
        clip.certain,
        calm.trajectory.weight / config.trajectory.weight,
    )
    if clip.has_pixels or clip.targets is None:
        prepared = prepare(actor, clip.cameras, clip.detections, config.position.gate)
        motion, _ = initialize(actor, clip.cameras, prepared, config, unit)
        points, weights = joint_places(clip.cameras, prepared)
        if clip.targets is None and int(((weights > 0).sum(-1) >= _FIT_POINTS).sum()):
            motion = _better_seen(actor, clip, config, unit, motion, points, weights)
        trusted = prepared.detections.trusted3d
        return replace(problem, detections=replace(clip.detections, trusted3d=trusted)), motion
    return problem, _placed_start(actor, clip, config)


def _better_seen(
    actor: Actor,
    clip: ClipEstimate,
    config: PoseConfig,
    unit: Tensor,
    motion: Motion,
    points: Tensor,
    weights: Tensor,
) -> Motion:
    """Each frame as it is, or as its joints' rough places show it, whichever images fit better.

    From the neutral pose, places lead limbs around where pixels catch them in a wrong minimum.

    Args:
        actor: gives the joints.
        clip: the estimate.
        config: of the pose.
        unit: one percent of the person's height in each view, (C,), pixels.
        motion: (F,).
        points: rough places of the joints in the world, (F, 16, 3).
        weights: of them, 0 where there are none, (F, 16).
    """
    certain = (weights > 0).to(points)[:, None]
    placed = replace(clip, targets=points.nan_to_num()[:, None], certain=certain)
    other = _placed_start(actor, placed, config)
    pixels = pose_objective(actor, clip.cameras, clip.detections, config, unit).energies["joints2d"]
    assert isinstance(pixels, Reprojection)
    own, others = (
        pixels.kernel.value(pixels.residual(each).squared_norm()).sum(-1)
        for each in (motion, other)
    )
    return other.where(others < own, motion)


def _placed_start(actor: Actor, clip: ClipEstimate, config: PoseConfig) -> Motion:
    """Each frame's pose where only places of joints are known; frames without any are filled."""
    assert clip.targets is not None
    points, certain = clip.targets, clip.certain
    total = certain.sum(1)
    middle = (certain[..., None] * points).sum(1) / total.clamp(min=1e-9)[..., None]
    start = trunk_start(actor, middle, total)
    energies = {
        "targets": targets_energy(actor, points[:, None], certain[:, None], config),
        "prior": PosePrior(neutral_angles(actor), config.prior.deviation, config.prior.weight),
    }
    initial = start.map(lambda each: each[:, None])
    method = LevenbergMarquardt(config.initial_steps, tolerance=config.initial_tolerance)
    objective = Objective(energies).to(actor.skeleton.lower)
    found: Motion = solve(objective, initial, method, angle_bounds(actor)).state
    return fill_gaps(found.map(lambda each: each[:, 0]), (total > 0).sum(-1) >= _FIT_POINTS)
