"""Skeleton motion pulled towards the silhouettes (Xu et al. 2018, Sec. 5.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.contour_alignment import ContourAlignment
from perfcap.energy.joint_target import JointTarget
from perfcap.geometry.camera import Camera
from perfcap.memory import give_back
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, motions
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.lost_limbs import FoundLimb
from perfcap.pipeline.objective import angle_bounds, kernel
from perfcap.pipeline.overlap import blocks, clip_overlaps, keep_better
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface import SkinnedSurface
from perfcap.pipeline.surface_config import RefinePoseConfig
from perfcap.pipeline.track_motion import MotionBlender, Progress
from perfcap.segment import Contour, Correspondences, stack
from perfcap.solve import Energy, LevenbergMarquardt, Objective, Step, solve
from perfcap.temporal.window import Window, partition


@dataclass(frozen=True)
class PoseRefinement:
    """The refined motion, and how well every frame overlaps its masks.

    Attributes:
        motion: (F,).
        before: intersection over union of surface and masks under the motion given, (F,).
        after: under the refined motion as it is here, (F,).
        kept: False in frames that the refinement would have made worse; they are as given, (F,).
        limbs: that were searched for and found before, see ``find_lost_limbs``.
    """

    motion: Motion
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    kept: NDArray[np.bool_]
    limbs: tuple[FoundLimb, ...] = ()


def refine_pose(
    problem: ClipProblem,
    sight: Sight,
    evidence: Evidence,
    motion: Motion,
    config: RefinePoseConfig,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> PoseRefinement:
    """Minimise E_con + w_stab E_stab (Eq. 10), correspondences searched anew in every round.

    With ``config.whole`` the objective of the motion itself is in it too. A frame in which the
    result overlaps the masks less than before keeps its motion, and its neighbours fade towards it.

    Args:
        problem: the actor, and the windows and the temporal prior of its motion.
        sight: cameras in the pixels of the masks.
        evidence: masks and their contours.
        motion: (F,).
        config: rounds, weights, units.
        workers: threads; all cores when not given.
        progress: called with (frames done, frames).
        checkpoint: keeps finished windows.
    """
    windows = partition(motion.frames, problem.config.window, problem.config.overlap)

    def refined(window: Window) -> Motion:
        part = motion[window.index]
        terms = _Terms(problem, window, part, config, evidence.pixel_unit)
        lines = [evidence.contours(frame) for frame in range(window.start, window.stop)]
        for _ in range(config.rounds):
            pairs = _search(problem.actor, sight, lines, evidence.heights, window, part, config)
            part = terms.solve(part, pairs, sight.cameras.frames(window.index))
        return part

    blender = MotionBlender()
    kept = checkpoint.kept("refine_pose")
    parts = kept.each(motions(motion.angles), refined, windows, workers)
    for window, part in zip(windows, parts, strict=True):
        blender.push(window, part)
        if progress is not None:
            progress(window.stop, motion.frames)
    found = blender.finish(problem.actor.skeleton)
    give_back()

    rounds = count()

    def overlaps(motion: Motion) -> NDArray[np.float64]:
        kept = checkpoint.kept(f"refine_pose_overlap_{next(rounds)}")
        surface = SkinnedSurface(problem.actor, motion)
        return clip_overlaps(surface, sight, evidence, workers, kept)

    before = overlaps(motion)
    result, after, better = keep_better(partial(_faded, motion, found), overlaps, before)
    return PoseRefinement(result, before, after, better)


class _Terms:
    """The refinement of one window: what stays the same in all rounds."""

    def __init__(
        self,
        problem: ClipProblem,
        window: Window,
        start: Motion,
        config: RefinePoseConfig,
        pixel_unit: Tensor,
    ) -> None:
        actor, joints = problem.actor, problem.actor.landmarks
        self.actor, self.config, self.pixel_unit = actor, config, pixel_unit
        self.method = LevenbergMarquardt(max_steps=config.max_steps, tolerance=config.tolerance)
        self.fixed: dict[str, Energy[Motion]] = {
            "stabilization": JointTarget(  # Eq. 12, a mean over the joints
                joints,
                joints(start).unsqueeze(-3),
                weight=config.stabilization / joints.count,
                unit=config.deviation,
            )
        }
        if config.whole:
            self.fixed.update(problem.objective(window).items())

    def solve(self, motion: Motion, pairs: Correspondences, cameras: Camera) -> Motion:
        contour = self.config.contour
        alignment = ContourAlignment(
            SkinnedPoints(
                self.actor, pairs.vertices.flatten(-3, -2), pairs.weights.flatten(-3, -2)
            ),
            cameras,
            pairs,
            contour.weight,
            kernel(contour.scale),
            contour.deviation * self.pixel_unit,
        )
        objective = Objective({"contour": alignment, **self.fixed}).to(motion.angles)
        refined: Motion = solve(objective, motion, self.method, angle_bounds(self.actor)).state
        return refined


def _search(
    actor: Actor,
    sight: Sight,
    lines: Sequence[Sequence[Contour]],
    heights: Sequence[float],
    window: Window,
    motion: Motion,
    config: RefinePoseConfig,
) -> Correspondences:
    """Pairs of a window's frames; label maps live only as long as their frame."""
    surface = SkinnedSurface(actor, motion)
    matches = []
    for frames in blocks(window.start, window.stop):
        first, stop = frames.start - window.start, frames.stop - window.start
        drawn = sight.stream(surface[first:stop], slice(frames.start, frames.stop))
        matches += [
            sight.correspond(row, contours, config.contour, heights)
            for row, contours in zip(drawn, lines[first:stop], strict=True)
        ]
    return stack(matches, motion.angles)


def _faded(given: Motion, found: Motion, share: Tensor) -> Motion:
    """The motion given, and a share (F,) of the way to the one found."""
    step = given.local(found)
    return given.retract(Step(share.to(step.frame)[:, None] * step.frame, step.shared))
