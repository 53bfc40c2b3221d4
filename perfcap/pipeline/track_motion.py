"""Skeleton motion: windows solved in batches, blended into one motion as they finish."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.objective import angle_bounds, pose_objective, trajectory_prior
from perfcap.solve import LevenbergMarquardt, Status, solve
from perfcap.temporal.window import Blender, Window, mean_rotations, mean_vectors, partition

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class WindowReport:
    """How the solve of one window went."""

    window: Window
    status: Status
    steps: int
    energy: float
    terms: dict[str, float]


def track_motion(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    initial: Motion,
    config: PoseConfig,
    pixel_unit: Tensor,
    rate: float,
    progress: Progress | None = None,
) -> tuple[Motion, list[WindowReport]]:
    """Minimise E_pose over windows (Xu et al. 2018, Eq. 2 and 3) and blend them (MPC-9).

    Windows are independent and a batch dimension: ``config.batch`` of them are solved at once and
    blended right away, so memory does not grow with the clip beyond detections and result.

    Args:
        actor: gives the joints and the limits.
        cameras: C views, fixed or moving.
        detections: (F, C), prepared.
        initial: motion to start from, (F,).
        config: windows, weights, units.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
        rate: frames a second.
        progress: called with (frames done, frames).

    Returns:
        The motion (F,), every angle within its limits, and a report for each window.
    """
    frames = detections.frame_count
    windows = partition(frames, config.window, config.overlap)
    blend = _Blend()
    reports: list[WindowReport] = []
    for group in _batches(windows, config.batch):
        solved, report = _solve_group(
            actor, cameras, detections, initial, config, pixel_unit, rate, group
        )
        blend.push(group, solved)
        reports += report
        if progress is not None:
            progress(group[-1].stop, frames)
    motion = blend.finish()
    # a mean of bounded angles is bounded; only its rounding can be a bit outside
    angles = motion.angles.clamp(actor.skeleton.lower, actor.skeleton.upper)
    return replace(motion, angles=angles), reports


def _solve_group(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    initial: Motion,
    config: PoseConfig,
    pixel_unit: Tensor,
    rate: float,
    group: list[Window],
) -> tuple[Motion, list[WindowReport]]:
    index = torch.stack([torch.arange(w.start, w.stop) for w in group]).to(initial.angles.device)
    objective = pose_objective(
        actor,
        cameras.frames(index),
        _gather(detections, index),
        config,
        pixel_unit,
        trajectory_prior(config.trajectory, index.shape[1], rate),
    )
    start = Motion(initial.translation[index], initial.rotation[index], initial.angles[index])
    method = LevenbergMarquardt(max_steps=config.max_steps, tolerance=config.tolerance)
    solution = solve(objective, start, method, angle_bounds(actor))
    reports = [
        WindowReport(
            window,
            Status(int(solution.status[i])),
            int(solution.steps[i]),
            float(solution.energy[i]),
            {name: float(term[i]) for name, term in solution.terms.items()},
        )
        for i, window in enumerate(group)
    ]
    motion: Motion = solution.state
    return motion, reports


def _gather(detections: Detections, index: Tensor) -> Detections:
    """Detections (F, C) of windows of frames (N, W): (N, W, C)."""
    joints3d = detections.joints3d
    return Detections(
        detections.joints2d[index],
        detections.confidence2d[index],
        None if joints3d is None else joints3d[index],
        detections.trusted3d[index],
    )


class _Blend:
    """One motion of overlapping windows: linear in the overlaps, on SO(3) for the root.

    Holds the windows that the next one may overlap, and the finished frames.
    """

    def __init__(self) -> None:
        means = (mean_vectors, mean_rotations, mean_vectors)
        self._blenders = [Blender(mean) for mean in means]
        self._done: list[list[Tensor]] = [[], [], []]

    def push(self, group: list[Window], solved: Motion) -> None:
        """Take the solved windows (N, W) of a group."""
        for i, window in enumerate(group):
            values = (solved.translation[i], solved.rotation[i], solved.angles[i])
            for blender, done, value in zip(self._blenders, self._done, values, strict=True):
                done.append(blender.push(window, value))

    def finish(self) -> Motion:
        """The whole motion, (F,)."""
        for blender, done in zip(self._blenders, self._done, strict=True):
            done.append(blender.finish())
        return Motion(*(torch.cat(done) for done in self._done))


def _batches(windows: list[Window], size: int) -> Iterator[list[Window]]:
    for start in range(0, len(windows), size):
        yield windows[start : start + size]
