"""Skeleton motion pulled towards the silhouettes (Xu et al. 2018, Sec. 5.2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.contour_alignment import ContourAlignment
from perfcap.energy.stabilization import Stabilization
from perfcap.geometry.camera import Camera
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.motion_blender import MotionBlender
from perfcap.pipeline.objective import angle_bounds, kernel
from perfcap.pipeline.sight import Sight, View, overlap
from perfcap.pipeline.surface_config import RefinePoseConfig
from perfcap.pipeline.track_motion import MotionProblem, Progress
from perfcap.pipeline.workers import ordered_map
from perfcap.segment import Correspondences, stack
from perfcap.solve import Energy, LevenbergMarquardt, Objective, Step, solve
from perfcap.temporal.window import Window, partition

_BLOCK = 8  # frames drawn at once
_FADE = 2  # frames over which a rejected frame's neighbours return to their refinement
_WORSE = 1e-3  # of overlap; rasterisation alone moves it by less


@dataclass(frozen=True)
class PoseRefinement:
    """The refined motion, and how well every frame overlaps its masks.

    Attributes:
        motion: (F,).
        before: intersection over union of surface and masks under the motion given, (F,).
        after: under the refined motion, (F,).
        kept: False in frames that the refinement would have made worse; they are as given, (F,).
    """

    motion: Motion
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    kept: NDArray[np.bool_]


def refine_pose(
    problem: MotionProblem,
    sight: Sight,
    evidence: Evidence,
    motion: Motion,
    config: RefinePoseConfig,
    workers: int | None = None,
    progress: Progress | None = None,
) -> PoseRefinement:
    """Minimise E_con + w_stab E_stab, with correspondences searched anew in every round.

    A frame in which the result overlaps the masks less than before keeps its motion, and its
    neighbours fade towards it.

    Args:
        problem: the actor, and the windows and the temporal prior of its motion.
        sight: cameras in the pixels of the masks.
        evidence: masks and their contours.
        motion: (F,).
        config: rounds, weights, units.
        workers: threads; all cores when not given.
        progress: called with (frames done, frames).
    """
    windows = partition(motion.frames, problem.config.window, problem.config.overlap)

    def refined(window: Window) -> Motion:
        part = motion[window.index]
        terms = _Terms(problem, window, part, config, evidence.pixel_unit)
        for _ in range(config.rounds):
            pairs = _search(problem.actor, sight, evidence, window, part, config)
            part = terms.solve(part, pairs, sight.cameras.frames(window.index))
        return part

    blender = MotionBlender()
    for window, part in zip(windows, ordered_map(refined, windows, workers), strict=True):
        blender.push(window, part)
        if progress is not None:
            progress(window.stop, motion.frames)
    found = blender.finish(problem.actor.skeleton)
    return _guarded(problem.actor, sight, evidence, motion, found, workers)


class _Terms:
    """The refinement of one window: what stays the same in all rounds."""

    def __init__(
        self,
        problem: MotionProblem,
        window: Window,
        start: Motion,
        config: RefinePoseConfig,
        pixel_unit: Tensor,
    ) -> None:
        actor = problem.actor
        self.actor, self.config, self.pixel_unit = actor, config, pixel_unit
        self.method = LevenbergMarquardt(max_steps=config.max_steps, tolerance=config.tolerance)
        self.fixed: dict[str, Energy[Motion]] = {
            "stabilization": Stabilization(
                actor, actor.joints(start), config.stabilization, unit=config.deviation
            )
        }
        if config.whole:
            self.fixed.update(problem.objective(window.index).items())

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
    evidence: Evidence,
    window: Window,
    motion: Motion,
    config: RefinePoseConfig,
) -> Correspondences:
    """Pairs of a window's frames; label maps live only as long as their block of frames."""
    matches = []
    for frames, drawn in _drawn(actor, sight, motion, window.start):
        matches += [
            sight.correspond(row, evidence.contours(frame), config.contour, evidence.heights)
            for frame, row in zip(frames, drawn, strict=True)
        ]
    return stack(matches, motion.angles)


def _drawn(
    actor: Actor, sight: Sight, motion: Motion, first: int
) -> Iterator[tuple[range, list[list[View]]]]:
    """Blocks of frames of the clip and the surface drawn in them; ``first`` is the motion's."""
    for start in range(0, motion.frames, _BLOCK):
        part = motion[start : start + _BLOCK]
        frames = range(first + start, first + start + part.frames)
        yield frames, sight.look(actor.surface(part), slice(frames.start, frames.stop))


def _guarded(
    actor: Actor,
    sight: Sight,
    evidence: Evidence,
    given: Motion,
    found: Motion,
    workers: int | None,
) -> PoseRefinement:
    """The refined motion where it overlaps the masks at least as well as the motion given."""

    def overlaps(block: range) -> list[tuple[float, float]]:
        span = slice(block.start, block.stop)
        rows = (sight.look(actor.surface(motion[span]), span) for motion in (given, found))
        return [
            (overlap(one, masks), overlap(other, masks))
            for one, other, masks in zip(*rows, map(evidence.masks, block), strict=True)
        ]

    blocks = [
        range(start, min(start + _BLOCK, given.frames)) for start in range(0, given.frames, _BLOCK)
    ]
    both = np.array([pair for block in ordered_map(overlaps, blocks, workers) for pair in block])
    before, after = both.T
    kept = after >= before - _WORSE
    motion = _faded(given, found, kept)
    return PoseRefinement(motion, before, np.where(kept, after, before), kept)


def _faded(given: Motion, found: Motion, kept: NDArray[np.bool_]) -> Motion:
    """The motion found, and the one given in frames that are not kept, with ramps between."""
    if kept.all():
        return found
    distance = ndimage.distance_transform_cdt(kept, "chessboard") if kept.any() else kept * 0
    share = torch.from_numpy(np.minimum(distance / (_FADE + 1), 1.0)).to(given.angles)[:, None]
    step = given.local(found)
    return given.retract(Step(share * step.frame, step.shared))
