"""The windows of a clip solved twice: what the first solve shows goes into the second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.pipeline.adapt import adapted, with_standing
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.gaps import fill_gaps
from perfcap.pipeline.track_motion import MotionBlender, WindowReport, solve_each, track_motion

# --------------------------------------------------------------------------------------------------
# Stretches of a solved motion that fit badly, solved again from what is on either side of them.
#
# A few frames that started from a wrong pose, left and right exchanged in one view, pull the frames
# about them along into a minimum of their own: it fits far worse than the rest of the clip. From
# the poses before and after such a stretch the solver finds the better one.

_BADLY = 1.6  # times the median misfit of a frame, and at least this many frames in a row
_RUN = 2
_REACH = 4  # frames on either side that were pulled along
_ROUNDS = 2
_LESS = 0.999  # of the energy of a window, or nothing changes


def mended(
    problem: ClipProblem,
    motion: Motion,
    reports: list[WindowReport],
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> tuple[Motion, list[WindowReport]]:
    """The motion (F,) with windows that have less energy from another start, and all reports.

    Energies never rise. Windows without a stretch that fits badly stay as they are.

    Args:
        problem: the clip, and settings.
        motion: what ``track_motion`` found.
        reports: of its windows.
        checkpoint: keeps the windows of each round.
    """
    known, found = {report.window: report for report in reports}, motion
    for again in range(_ROUNDS):
        bad = _misfits(list(known.values()), motion.frames)
        if not bool(bad.any()) or bool(bad.all()):
            break
        windows = [w for w in known if bool(bad[w.index].any())]
        start = fill_gaps(found, ~bad.to(found.angles.device))
        kept = checkpoint.kept(f"mend_{again}")
        solved = dict(zip(windows, solve_each(problem, start, windows, kept), strict=True))
        better = {
            window: pair
            for window, pair in solved.items()
            if pair[1].energy < _LESS * known[window].energy
        }
        if not better:
            break
        blender = MotionBlender()
        for window in known:
            own = better[window][0] if window in better else found[window.index]
            blender.push(window, own)
        found = blender.finish(problem.actor.skeleton)
        known |= {window: report for window, (_, report) in better.items()}
    return found, list(known.values())


def _misfits(reports: list[WindowReport], frames: int) -> Tensor:
    """Frames in or near stretches whose joints are badly met in the images, (F,), bool."""
    total, count = torch.zeros(2, frames, dtype=torch.float64).unbind()
    for report in reports:
        values = report.frame_terms.get("joints2d")
        if values is not None:
            total[report.window.index] += torch.tensor(values, dtype=torch.float64)
            count[report.window.index] += 1
    misfit = total / count.clamp(min=1)
    above = misfit > _BADLY * misfit.median()
    runs = torch.stack([above.roll(-step) for step in range(_RUN)]).all(0)
    if _RUN > 1:
        runs[-_RUN + 1 :] = False
    pool = torch.nn.functional.max_pool1d
    wide = 2 * _REACH + _RUN
    padded = torch.nn.functional.pad(runs.double()[None], (_REACH + _RUN - 1, _REACH))
    return pool(padded, wide, 1)[0] > 0


# --- The windows of a clip solved twice: what the first solve shows goes into the second ----------

Progress = Callable[[int, int], None]


def track_twice(
    problem: ClipProblem,
    initial: Motion,
    progress: Progress | None = None,
    kept: Checkpoint = NO_CHECKPOINT,
) -> tuple[Motion, list[WindowReport], ClipProblem]:
    """Solve the windows with the stated settings, then with what that shows of errors and motion.

    From the smooth motion of the first solve, the second one with its weaker prior does not
    follow wrong detections, which it would from the frames each on its own. One view without 3D
    joints keeps the first prior: there it alone tells depth. What the first solve shows of the
    floor and of feet that stand is in the second one too. Stretches that several views contradict
    are solved again in between.

    Returns:
        The motion (F,), a report for each window, and the problem that was solved last.
    """
    last, stands = kept.kept("track_motion"), problem.config.contact.enabled
    if not twice(problem) and not stands:
        return *track_motion(problem, initial, progress, last), problem
    first = kept.kept("track_motion_first")
    begun = loose(problem) if twice(problem) else problem
    rough, reports = track_motion(begun, initial, _half(progress, 0), first)
    if problem.detections.views > 1:
        rough, reports = mended(begun, rough, reports, kept)
    known = adapted(problem, rough) if twice(problem) else problem
    known = with_standing(known, rough) if stands else known
    if known is problem or (not twice(problem) and known.standing is None):
        return rough, reports, problem
    if known.standing is not None:
        rough = replace(rough, translation=rough.translation + known.standing.shift)
    return *track_motion(known, rough, _half(progress, 1), last), known


def twice(problem: ClipProblem) -> bool:
    """Whether a first solve of a clip tells the second its weights and its prior."""
    return problem.config.evidence.enabled and problem.tells_depth


def loose(problem: ClipProblem) -> ClipProblem:
    """The problem as it is solved the first time."""
    config = problem.config
    tolerance = max(config.tolerance, config.evidence.tolerance)
    return replace(problem, config=replace(config, tolerance=tolerance))


def _half(progress: Progress | None, which: int) -> Progress | None:
    """What tells the progress of the first or the second of two equal parts."""
    if progress is None:
        return None
    return lambda done, total: progress(which * total + done, 2 * total)
