"""Fixed cameras put where the silhouettes of a moving person agree.

Detectors of joints err by the same pixels in frame after frame, each view in its own way, and a
camera that is turned by half a degree looks no different. Outlines are better known: poses of
frames spread over the clip and all cameras are solved together until outlines of the skinned
surface lie on those of the silhouettes. Not in the paper, which has one camera.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import SkinnedPoints
from perfcap.energy.joint_target import JointTarget
from perfcap.energy.prior import SharedPrior
from perfcap.energy.uncertain_contours import UncertainContours
from perfcap.energy.uncertain_views import CAMERAS
from perfcap.pipeline.bone_lengths import spread_frames
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, tensors
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.objective import angle_bounds, kernel
from perfcap.pipeline.sight import Sight
from perfcap.pipeline.surface import SkinnedSurface, SurfaceFrames
from perfcap.pipeline.surface_config import RefineCamerasConfig
from perfcap.pipeline.track_motion import Progress
from perfcap.pipeline.uncertain_problem import CORRELATION
from perfcap.pipeline.view_errors import ViewErrors
from perfcap.segment import Correspondences, stack
from perfcap.segment.correspondence import Matches
from perfcap.solve import Bounds, LevenbergMarquardt, Objective, Step, solve
from perfcap.solve.covariance import shared_covariance
from perfcap.workers import ordered_map


def can_refine_cameras(sight: Sight) -> bool:
    """Whether there are cameras that silhouettes can bring together: two or more, which stand."""
    return sight.views > 1 and not sight.cameras.moving


def refine_cameras(
    problem: ClipProblem,
    sight: Sight,
    evidence: Evidence,
    motion: Motion,
    config: RefineCamerasConfig,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> ViewErrors:
    """Turns and shifts of fixed cameras with which silhouettes agree, and their deviations.

    Args:
        problem: the actor, and the detections that say which frames show it well.
        sight: C fixed cameras in the pixels of the masks.
        evidence: masks and their contours.
        motion: (F,), as near as joints have it.
        config: rounds, weights, units.
        workers: threads; all cores when not given.
        progress: called with (rounds done, rounds).
        checkpoint: keeps the result.
    """

    def found() -> tuple[Tensor, Tensor]:
        frames = spread_frames(problem.detections, config.frames)
        own = _Problem(problem, sight, evidence, motion[frames], frames, config)
        unknown = motion.angles.new_zeros(6 * sight.views)
        state = replace(own.start, shared={CAMERAS: unknown})
        objective = own.objective(state, workers)
        for done in range(1, config.rounds + 1):
            state = own.solved(objective, state)
            objective = own.objective(state, workers)
            if progress is not None:
                progress(done, config.rounds)
        alike = max(1.0, CORRELATION * state.frames / motion.frames)  # frames that tell the same
        spread = (alike * shared_covariance(objective, state).diagonal()).sqrt()
        return state.shared[CAMERAS].reshape(-1, 6), spread.reshape(-1, 6)

    cameras, deviation = checkpoint.kept("refine_cameras").once(tensors(motion.angles), found)
    return ViewErrors(cameras=cameras, cameras_deviation=deviation)


_LOOKED_AT = 12  # frames that tell whether masks lie beside the body


def mask_offsets(surface: SurfaceFrames, sight: Sight, evidence: Evidence) -> NDArray[np.float64]:
    """How far the middles of masks lie beside those of a surface, (C, 2), percent of its height.

    To the right and down, the median of frames spread over the clip, but for what is common to all
    views: clothes and hair weigh as much in each. NaN in views without a mask.

    Args:
        surface: of F frames.
        sight: C cameras in the pixels of the masks.
        evidence: the masks.
    """
    chosen = np.unique(np.linspace(0, surface.frames - 1, _LOOKED_AT).round().astype(int)).tolist()
    apart = np.full((len(chosen), sight.views, 2), np.nan)
    for row, frame in zip(apart, chosen, strict=True):
        span = slice(frame, frame + 1)
        (drawn,) = sight.outlines(surface[span], span)
        for view, (outline, mask) in enumerate(zip(drawn, evidence.masks(frame), strict=True)):
            row[view] = _middle(mask) - _middle(outline.mask)
    apart /= evidence.pixel_unit.numpy(force=True)[:, None]
    known = np.isfinite(apart).all(-1).any(0)
    middle = np.full((sight.views, 2), np.nan)
    if known.any():
        middle[known] = np.nanmedian(apart[:, known], 0)
        middle[known] -= middle[known].mean(0)
    return middle


def _middle(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Column and row of the middle of a mask (H, W), px; NaN where it is empty."""
    size = np.count_nonzero(mask)
    if not size:
        return np.full(2, np.nan)
    return (
        np.array(
            [np.arange(n) @ mask.sum(axis) for axis, n in ((0, mask.shape[1]), (1, mask.shape[0]))]
        )
        / size
    )


class _Problem:
    """Poses of some frames and all cameras."""

    def __init__(
        self,
        problem: ClipProblem,
        sight: Sight,
        evidence: Evidence,
        start: Motion,
        frames: Tensor,
        config: RefineCamerasConfig,
    ) -> None:
        self.actor, self.sight, self.config = problem.actor, sight, config
        self.start, self.joints = start, problem.actor.joints(start)
        self.frames: list[int] = frames.tolist()
        self.lines = [evidence.contours(frame) for frame in self.frames]
        self.heights = evidence.heights
        self.unit = config.contour.deviation * evidence.pixel_unit
        self.bounds = angle_bounds(problem.actor)

    def _pairs(self, state: Motion, workers: int | None) -> Correspondences:
        """Of the contours of the surface as cameras of the state see it with those of masks."""
        surface = SkinnedSurface(self.actor, replace(state, shared={}))
        now = self.sight.through(self.sight.cameras.nudged(state.shared[CAMERAS]))

        def matched(place: int) -> list[Matches]:
            frame = self.frames[place]
            (drawn,) = now.look(surface[place : place + 1], slice(frame, frame + 1))
            return now.correspond(drawn, self.lines[place], self.config.contour, self.heights)

        return stack([*ordered_map(matched, range(len(self.frames)), workers)], state.angles)

    def objective(self, state: Motion, workers: int | None) -> Objective:
        """Contours as a state has them; joints and cameras stay about where they were."""
        config, contour, joints = self.config, self.config.contour, self.actor.landmarks
        pairs = self._pairs(state, workers)
        corners, shares = pairs.vertices.flatten(-3, -2), pairs.weights.flatten(-3, -2)
        size, spread = 6 * self.sight.views, [config.turn] * 3 + [config.shift] * 3
        return Objective(
            {
                "contour": UncertainContours(
                    SkinnedPoints(self.actor, corners, shares),
                    self.sight.cameras.to(state.angles),
                    pairs,
                    contour.weight,
                    kernel(contour.scale),
                    self.unit,
                ),
                "stabilization": JointTarget(
                    joints,
                    self.joints.unsqueeze(-3),
                    weight=config.stabilization / joints.count,
                    unit=config.deviation,
                ),
                "cameras prior": SharedPrior(
                    *(size, state.frames, torch.tensor(spread).repeat(self.sight.views)),
                    block=CAMERAS,
                ),
            }
        ).to(state.angles)

    def solved(self, objective: Objective, state: Motion) -> Motion:
        """A minimum from a state."""
        free = torch.full_like(state.shared[CAMERAS], torch.inf)
        low, high = self.bounds.lower.frame, self.bounds.upper.frame
        bounds = Bounds(Step(low, -free), Step(high, free))
        found: Motion = solve(
            objective, state, LevenbergMarquardt(self.config.max_steps), bounds
        ).state
        return found
