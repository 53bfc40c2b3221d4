"""Bone lengths of the person, solved once over the clip before any window."""

from __future__ import annotations

import itertools
from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import BONES
from perfcap.detect.detections import Detections
from perfcap.energy.prior import BoneLengthPrior
from perfcap.errors import InputError
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.objective import FrameProblem, angle_bounds
from perfcap.pipeline.prepare import prepare
from perfcap.solve import Bounds, LevenbergMarquardt, Objective, Step, solve

_JOINTS = 6  # of a frame, that two views are to show


def shows_bone_lengths(detections: Detections) -> bool:
    """Whether some frame is seen by two views, without which nobody knows how long bones are."""
    together = (detections.confidence2d > 0).sum(-2) > 1  # F J
    return bool((together.sum(-1) >= _JOINTS).any())


def solve_bone_lengths(problem: FrameProblem) -> Tensor:
    """Log factors of the actor's bone groups that fit the person, (S,).

    A person is not the template. Frames spread over the clip are solved together with one set of
    bone lengths (left and right equal), the shared unknowns of the arrow-shaped system; a prior
    keeps proportions human where the views say little. Frames are independent otherwise.

    Args:
        problem: the clip as detected, of the template person.

    Raises:
        InputError: no two views show the person at once; in one, size and depth trade off.
    """
    actor, config = problem.actor, problem.config
    if not shows_bone_lengths(problem.detections):
        raise InputError(
            f"bone lengths: no frame shows {_JOINTS} joints in two views at once, which would tell "
            "them; keep the template's (--bones template), or build a body of the person's height"
        )
    chosen = spread_frames(problem.detections, config.bones.frames)
    prepared = prepare(problem.frames(chosen))
    motion, _ = initialize(prepared)
    # 3D poses are matched by their directions, the more closely the shorter the bones are
    seen = replace(prepared.detections, joints3d=None)
    groups = len(actor.skeleton.group_names)
    prior = BoneLengthPrior(groups, len(chosen), config.bones.size, config.bones.own)
    plain = replace(prepared.problem, detections=seen).objective()
    objective = Objective(dict(plain.items()), bones=prior.to(motion.angles))
    start = replace(motion, shared={BONES: motion.angles.new_zeros(groups)})
    limits = angle_bounds(actor)
    free = motion.angles.new_full((groups,), torch.inf)
    bounds = Bounds(Step(limits.lower.frame, -free), Step(limits.upper.frame, free))
    method = LevenbergMarquardt(max_steps=config.bones.max_steps)
    return solve(objective, start, method, bounds).state.shared[BONES]


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


def fitted(actor: Actor, bones: Tensor) -> Actor:
    """The actor with other bone lengths, under the same name."""
    resized = actor.resized(bones)
    resized.template = replace(resized.template, name=actor.template.name)
    return resized
