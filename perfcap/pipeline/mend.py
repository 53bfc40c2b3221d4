"""Stretches of a solved motion that fit badly, solved again from what is on either side of them.

A few frames that started from a wrong pose, left and right exchanged in one view, pull the frames
about them along into a minimum of their own: it fits far worse than the rest of the clip. From the
poses before and after such a stretch the solver finds the better one.
"""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.gaps import fill_gaps
from perfcap.pipeline.motion_blender import MotionBlender
from perfcap.pipeline.track_motion import WindowReport, solve_each

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
