"""The windows of a clip solved twice: what the first solve shows goes into the second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from perfcap.actor.motion import Motion
from perfcap.pipeline.adapt import adapted, with_standing
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.mend import mended
from perfcap.pipeline.track_motion import WindowReport, track_motion

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
