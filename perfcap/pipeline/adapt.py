"""From a motion solved once to the settings of its second solve."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.config import EvidenceConfig, PoseConfig, PositionConfig, TrajectoryConfig
from perfcap.pipeline.error_sizes import calibrated, gain, variance
from perfcap.pipeline.objective import pose_objective
from perfcap.pipeline.prior_evidence import evident_stiffness
from perfcap.pipeline.track_motion import (
    FittedPrior,
    MotionProblem,
    Progress,
    WindowReport,
    track_motion,
)
from perfcap.solve.energy import Energy
from perfcap.temporal.window import partition

_STRETCH = 500  # frames whose errors are looked at together


def track_twice(
    problem: MotionProblem,
    initial: Motion,
    progress: Progress | None = None,
    kept: Checkpoint = NO_CHECKPOINT,
) -> tuple[Motion, list[WindowReport], MotionProblem]:
    """Solve the windows with the stated settings, then with what that shows of errors and motion.

    From the smooth motion of the first solve, the second one with its weaker prior does not
    follow wrong detections, which it would from the frames each on its own. One view without 3D
    joints is solved once: there the prior alone tells depth.

    Returns:
        The motion (F,), a report for each window, and the problem that was solved last.
    """
    config, detections = problem.config, problem.detections
    last = kept.kept("track_motion")
    if not config.evidence.enabled or (detections.views == 1 and detections.joints3d is None):
        return *track_motion(problem, initial, progress, last), problem
    loose = replace(config, tolerance=max(config.tolerance, config.evidence.tolerance))
    first = kept.kept("track_motion_first")
    rough, _ = track_motion(replace(problem, config=loose), initial, _half(progress, 0), first)
    known = adapted(problem, rough)
    return *track_motion(known, rough, _half(progress, 1), last), known


def _half(progress: Progress | None, which: int) -> Progress | None:
    """What tells the progress of the first or the second of two equal parts."""
    if progress is None:
        return None
    return lambda done, total: progress(which * total + done, 2 * total)


@torch.no_grad()
def adapted(problem: MotionProblem, motion: Motion) -> MotionProblem:
    """The problem with weights from the sizes of its errors and a prior that its windows ask for.

    Args:
        problem: the clip, and the settings of the first solve.
        motion: what that found, (F,).
    """
    config, detections = problem.config, problem.detections
    squared2d, squared3d = _squared_errors(problem, motion)
    confidence = calibrated(detections.confidence2d, squared2d)
    position = config.position
    if squared3d is not None:
        trusted = detections.trusted3d[..., None].expand(squared3d.shape)
        position = adapted_position(position, squared3d, trusted)
    known = replace(
        problem,
        detections=replace(detections, confidence2d=confidence),
        config=replace(
            config, position=position, trajectory=fine(config.trajectory, config.evidence)
        ),
    )
    return replace(known, fitted=_fitted(known, motion, config))


def fine(config: TrajectoryConfig, evidence: EvidenceConfig) -> TrajectoryConfig:
    """The prior of a second solve, but for its stiffness."""
    return replace(config, rank=evidence.rank, edge=evidence.edge)


def adapted_position(config: PositionConfig, squared: Tensor, trusted: Tensor) -> PositionConfig:
    """A kernel as wide as errors are, and more weight where they are smaller than nominal.

    Args:
        config: of the first solve.
        squared: squared errors of 3D joints in their stated deviation.
        trusted: those that count, likewise.
    """
    share = min(1.0, variance(squared, trusted, 3))
    scale = None if config.scale is None else config.scale * max(share, 1e-4) ** 0.5
    return replace(config, scale=scale, weight=config.weight * gain(squared, trusted, 3))


def squared_errors(energy: Energy[Motion], motion: Motion, like: Tensor) -> Tensor:
    """Squared norms of an energy's groups in their unit, confidence aside, as ``like``."""
    return energy.residual(motion).value.square().sum(-1).reshape(like.shape)


def _squared_errors(problem: MotionProblem, motion: Motion) -> tuple[Tensor, Tensor | None]:
    """Of 2D and, where there are any, of 3D joints, (F, C, 16)."""
    found2d, found3d = [], []
    for start in range(0, motion.frames, _STRETCH):
        part = slice(start, start + _STRETCH)
        cameras, seen = problem.cameras.frames(part), problem.detections.frames(part)
        objective = pose_objective(problem.actor, cameras, seen, problem.config, problem.pixel_unit)
        energies, like = dict(objective.items()), seen.confidence2d
        found2d.append(squared_errors(energies["joints2d"], motion[part], like))
        if seen.joints3d is not None:
            known = "joints3d" in energies
            none = torch.full_like(like, torch.nan)
            found3d.append(
                squared_errors(energies["joints3d"], motion[part], like) if known else none
            )
    return torch.cat(found2d), torch.cat(found3d) if found3d else None


def _fitted(problem: MotionProblem, motion: Motion, first: PoseConfig) -> FittedPrior:
    """The stiffness of every window, from the evidence."""
    windows = partition(motion.frames, first.window, first.overlap)
    found = []
    for start in range(0, len(windows), first.batch):
        group = windows[start : start + first.batch]
        index = torch.stack([torch.arange(w.start, w.stop) for w in group]).to(motion.angles.device)
        found.append(evident_stiffness(problem.objective(index), motion[index], first))
    return FittedPrior(tuple(window.start for window in windows), torch.cat(found))
