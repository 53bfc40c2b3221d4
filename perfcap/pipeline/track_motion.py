"""Skeleton motion: windows solved in batches, blended into one motion as they finish."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.energy.joint_trajectory import JointTrajectory
from perfcap.io.journal import Record
from perfcap.pipeline.checkpoint import NOTHING, Codec, Kept, motions
from perfcap.pipeline.clip_problem import ClipProblem, WindowData
from perfcap.pipeline.objective import angle_bounds, kernel
from perfcap.pipeline.own_energies import saying_which_frames, warn_of_windows
from perfcap.solve import Adjoint, LevenbergMarquardt, Objective, Solution, Status, solve
from perfcap.temporal.window import Blender, Window, mean_rotations, mean_vectors, partition

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


def track_motion(
    problem: ClipProblem,
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


def solve_each(
    problem: ClipProblem, initial: Motion, windows: Sequence[Window], kept: Kept = NOTHING
) -> Iterator[tuple[Motion, WindowReport]]:
    """Motion (W,) and report of some windows, in their order; see ``track_motion``."""
    groups = list(_batches(list(windows), problem.config.batch))
    results = kept.each(_codec(initial.angles), partial(_solve_group, problem, initial), groups)
    for solved, reports in results:
        for i, report in enumerate(reports):
            yield select(solved, i), report


def _solve_group(
    problem: ClipProblem, initial: Motion, group: list[Window]
) -> tuple[Motion, list[WindowReport]]:
    numbered = [(0, window) for window in group]
    solution, objective = solve_windows([problem], [initial], numbered)
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
    return replace(solution.state, shared={}), reports


def solve_windows(
    clips: Sequence[ClipProblem],
    initial: Sequence[Motion],
    group: Sequence[tuple[int, Window]],
    adjoint: Adjoint | None = None,
) -> tuple[Solution[Motion], Objective]:
    """Minimise E_pose of windows of one length at once (Xu et al. 2018, Eq. 2 and 3).

    Args:
        clips: with the same actor and settings.
        initial: motion of each clip to start from, (F,).
        group: windows, each with the number of its clip.
        adjoint: whether and how the solution carries gradients.

    Returns:
        The solution, of motions (N, W), and what was minimised.
    """
    problem = clips[group[0][0]]
    config = problem.config
    objective = problem.objective_of(
        WindowData.stack([clips[clip].at(window, clip) for clip, window in group])
    )
    given = Motion.stack([initial[clip][window.index] for clip, window in group])
    objective, start = _with_paths(problem, objective, given)
    method = LevenbergMarquardt(config.max_steps, config.tolerance, config.damping)
    bounds = angle_bounds(problem.actor)
    with saying_which_frames(problem.terms, group):
        solution = solve(objective, start, method, bounds, adjoint)
    warn_of_windows(problem.terms, objective, given, group)
    return solution, objective


def _with_paths(
    problem: ClipProblem, objective: Objective, start: Motion
) -> tuple[Objective, Motion]:
    """Windows with the paths that their settings ask for among the energies and the unknowns.

    Args:
        problem: of the windows.
        objective: of them.
        start: motion to start from, (N, W); its own paths are where theirs start.
    """
    config = problem.config.paths
    if config is None:
        return objective, start
    rank = min(config.rank, start.frames)
    robust = kernel(config.scale)
    energy = JointTrajectory(
        problem.actor.landmarks, start.frames, rank, config.weight, robust, config.deviation
    ).to(start.angles)
    return Objective(dict(objective.items()), paths=energy), energy.started(start)


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
        return {name: energy.per_frame(motion) for name, energy in objective.items()}


def select(motion: Motion, element: int) -> Motion:
    """One motion (F,) of a batch (N, F)."""
    return motion.map(lambda each: each[element])


def _batches(windows: list[Window], size: int) -> Iterator[list[Window]]:
    for start in range(0, len(windows), size):
        yield windows[start : start + size]


# --- Windows blended into one motion --------------------------------------------------------------


class MotionBlender:
    """Blends solved windows: linear in the overlaps, on SO(3) for the root (MPC-9).

    Holds the windows that the next one may overlap, and the finished frames.
    """

    def __init__(self) -> None:
        means = (mean_vectors, mean_rotations, mean_vectors)
        self._blenders = [Blender(mean) for mean in means]
        self._done: list[list[Tensor]] = [[], [], []]

    def push(self, window: Window, solved: Motion) -> None:
        """Take the motion of the next window, (W,)."""
        values = (solved.translation, solved.rotation, solved.angles)
        for blender, done, value in zip(self._blenders, self._done, values, strict=True):
            done.append(blender.push(window, value))

    def finish(self, skeleton: Skeleton) -> Motion:
        """The whole motion, (F,), every angle within the skeleton's limits."""
        for blender, done in zip(self._blenders, self._done, strict=True):
            done.append(blender.finish())
        translation, rotation, angles = (torch.cat(done) for done in self._done)
        # a mean of bounded angles is bounded; only its rounding can be a bit outside
        return Motion(translation, rotation, angles.clamp(skeleton.lower, skeleton.upper))
