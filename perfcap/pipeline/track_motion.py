"""Skeleton motion: windows solved in batches, blended into one motion as they finish."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.io.journal import Record
from perfcap.pipeline.checkpoint import NOTHING, Codec, Kept, motions
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.motion_blender import MotionBlender
from perfcap.pipeline.objective import angle_bounds, pose_objective, trajectory_prior
from perfcap.solve import LevenbergMarquardt, Objective, Status, solve
from perfcap.temporal.window import Window, partition

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class WindowReport:
    """How the solve of one window went; ``frame_terms`` are each energy's shares of its frames."""

    window: Window
    status: Status
    steps: int
    energy: float
    terms: dict[str, float]
    frame_terms: dict[str, list[float]] = field(default_factory=dict)


@dataclass(frozen=True)
class FittedPrior:
    """Stiffness of the trajectory prior of each window of a clip.

    Attributes:
        starts: first frame of every window.
        stiffness: factors on the weights of translation, rotation and each angle, (W, 2 + A).
    """

    starts: tuple[int, ...]
    stiffness: Tensor

    def at(self, index: slice | Tensor) -> Tensor:
        """Of the window of some frames, (2 + A,), or of several (N, W), (N, 2 + A)."""
        if isinstance(index, slice):
            return self.stiffness[self.starts.index(index.start)]
        rows = [self.starts.index(start) for start in index[..., 0].flatten().tolist()]
        return self.stiffness[rows].reshape(*index.shape[:-1], -1)


@dataclass(frozen=True)
class MotionProblem:
    """What the motion of a clip is found from.

    Attributes:
        actor: gives the joints and the limits.
        cameras: C views, fixed or moving.
        detections: (F, C), prepared.
        config: windows, weights, units.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
        rate: frames a second.
        fitted: the prior of each window, where a first solve found it; else that of ``config``.
    """

    actor: Actor
    cameras: Camera
    detections: Detections
    config: PoseConfig
    pixel_unit: Tensor
    rate: float
    fitted: FittedPrior | None = None

    def objective(self, index: slice | Tensor) -> Objective:
        """E_pose of a window (W,) of frames, or of several (N, W)."""
        seen = self.detections.map(lambda each: each[index])
        frames = seen.joints2d.shape[-4]
        stiffness = None if self.fitted is None else self.fitted.at(index)
        prior = trajectory_prior(self.config.trajectory, frames, self.rate, stiffness)
        cameras = self.cameras.frames(index)
        return pose_objective(self.actor, cameras, seen, self.config, self.pixel_unit, prior)


def track_motion(
    problem: MotionProblem,
    initial: Motion,
    progress: Progress | None = None,
    kept: Kept = NOTHING,
) -> tuple[Motion, list[WindowReport]]:
    """Minimise E_pose over windows (Xu et al. 2018, Eq. 2 and 3) and blend them (MPC-9).

    Windows are independent and a batch dimension: ``config.batch`` of them are solved at once and
    blended right away, so memory does not grow with the clip beyond detections and result.

    Args:
        problem: the clip, and settings.
        initial: motion to start from, (F,).
        progress: called with (frames done, frames).
        kept: windows that were solved before.

    Returns:
        The motion (F,), every angle within its limits, and a report for each window.
    """
    frames, config = problem.detections.frame_count, problem.config
    windows = partition(frames, config.window, config.overlap)
    blender = MotionBlender()
    reports: list[WindowReport] = []
    groups = list(_batches(windows, config.batch))
    codec = _codec(initial.angles)
    results = kept.each(codec, partial(_solve_group, problem, initial), groups)
    for group, (solved, report) in zip(groups, results, strict=True):
        for i, window in enumerate(group):
            blender.push(window, select(solved, i))
        reports += report
        if progress is not None:
            progress(group[-1].stop, frames)
    return blender.finish(problem.actor.skeleton), reports


def _solve_group(
    problem: MotionProblem, initial: Motion, group: list[Window]
) -> tuple[Motion, list[WindowReport]]:
    actor, config = problem.actor, problem.config
    index = torch.stack([torch.arange(w.start, w.stop) for w in group]).to(initial.angles.device)
    objective = problem.objective(index)
    method = LevenbergMarquardt(config.max_steps, config.tolerance, config.damping)
    solution = solve(objective, initial[index], method, angle_bounds(actor))
    shares = _frame_terms(objective, solution.state)
    reports = [
        WindowReport(
            window,
            Status(int(solution.status[i])),
            int(solution.steps[i]),
            float(solution.energy[i]),
            {name: float(term[i]) for name, term in solution.terms.items()},
            {name: share[i].tolist() for name, share in shares.items()},
        )
        for i, window in enumerate(group)
    ]
    motion: Motion = solution.state
    return motion, reports


def _codec(like: Tensor) -> Codec[tuple[Motion, list[WindowReport]]]:
    motion = motions(like)

    def pack(result: tuple[Motion, list[WindowReport]]) -> Record:
        solved, reports = result
        return {**motion.pack(solved), "reports": [asdict(report) for report in reports]}

    def unpack(record: dict[str, Any]) -> tuple[Motion, list[WindowReport]]:
        reports = [_report(values) for values in record.pop("reports")]
        return motion.unpack(record), reports

    return Codec(pack, unpack)


def _report(values: dict[str, Any]) -> WindowReport:
    window, status = Window(**values.pop("window")), Status(values.pop("status"))
    return WindowReport(window, status, **values)


def _frame_terms(objective: Objective, motion: Motion) -> dict[str, Tensor]:
    """Each energy of each frame, (N, W) by name; their sum over frames is the energy."""
    with torch.no_grad():
        return {
            name: energy.weight
            * energy.kernel.value(energy.residual(motion).squared_norm()).sum(-1)
            for name, energy in objective.items()
        }


def select(motion: Motion, element: int) -> Motion:
    """One motion (F,) of a batch (N, F)."""
    return motion.map(lambda each: each[element])


def _batches(windows: list[Window], size: int) -> Iterator[list[Window]]:
    for start in range(0, len(windows), size):
        yield windows[start : start + size]
