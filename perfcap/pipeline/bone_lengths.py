"""Bone lengths of the person, solved once over the clip before any window."""

from __future__ import annotations

import itertools
from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.prior import BoneLengthPrior
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import angle_bounds, pose_objective
from perfcap.pipeline.prepare import prepare
from perfcap.solve import Bounds, LevenbergMarquardt, Objective, Step, solve


def solve_bone_lengths(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    config: PoseConfig,
    pixel_unit: Tensor,
) -> Tensor:
    """Log factors of the actor's bone groups that fit the person, (S,).

    A person is not the template. Frames spread over the clip are solved together with one set of
    bone lengths (left and right equal), the shared unknowns of the arrow-shaped system; a prior
    keeps proportions human where the views say little. Frames are independent otherwise.

    Args:
        actor: the template person.
        cameras: C views, at least two: in a single one size and depth trade off, and whatever tells
            the directions of bones is matched better by short ones.
        detections: (F, C), as detected.
        config: of the pose.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.

    Raises:
        InputError: there is a single view.
    """
    if detections.views < 2:
        raise InputError(
            "bone lengths: there is one view, which does not tell them; expected two or more; keep "
            "the template's lengths (--bones template), or build a body of the person's height"
        )
    chosen = spread_frames(detections, config.bones.frames)
    cameras, some = cameras.frames(chosen), detections.frames(chosen)
    prepared = prepare(actor, cameras, some, config.position.gate)
    motion, _ = initialize(actor, cameras, prepared, config, pixel_unit)
    groups = len(actor.skeleton.group_names)
    prior = BoneLengthPrior(groups, len(chosen), config.bones.size, config.bones.own)
    plain = pose_objective(actor, cameras, prepared.detections, config, pixel_unit)
    objective = Objective(dict(plain.items()), bones=prior.to(motion.angles))
    start = Motion(
        motion.translation, motion.rotation, motion.angles, motion.angles.new_zeros(groups)
    )
    limits = angle_bounds(actor)
    free = motion.angles.new_full((groups,), torch.inf)
    bounds = Bounds(Step(limits.lower.frame, -free), Step(limits.upper.frame, free))
    method = LevenbergMarquardt(max_steps=config.bones.max_steps)
    shape: Tensor | None = solve(objective, start, method, bounds).state.shape
    assert shape is not None
    return shape


def spread_frames(detections: Detections, count: int) -> Tensor:
    """Frames spread over the clip, the best seen of each stretch, sorted, (<= count,)."""
    frames = detections.frame_count
    seen = detections.confidence2d.flatten(1).sum(-1)
    edges = torch.linspace(0, frames, min(count, frames) + 1).round().long().tolist()
    best = [
        start + int(seen[start:stop].argmax())
        for start, stop in itertools.pairwise(edges)
        if stop > start
    ]
    return torch.tensor([f for f in best if seen[f] > 0] or [0])


def fitted(actor: Actor, shape: Tensor) -> Actor:
    """The actor with other bone lengths, under the same name."""
    resized = actor.resized(shape)
    resized.template = replace(resized.template, name=actor.template.name)
    return resized
