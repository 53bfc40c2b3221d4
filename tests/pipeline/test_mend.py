"""Stretches that fit badly: found, solved again, and never to a higher energy."""

from __future__ import annotations

from dataclasses import replace

import torch
from takes import Take, make_take

from perfcap.actor.motion import Motion
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.track_motion import WindowReport, track_motion
from perfcap.pipeline.track_twice import _misfits, mended
from perfcap.solve import Status
from perfcap.temporal.window import Window


def problem_of(take: Take) -> ClipProblem:
    unit = 0.01 * take.detections.person_height()
    noise = torch.randn(
        take.detections.joints2d.shape, generator=torch.Generator().manual_seed(3)
    ).double()
    seen = replace(take.detections, joints2d=take.detections.joints2d + noise)
    return ClipProblem(take.actor, take.cameras, seen, PoseConfig(), unit, take.rate)


def turned(motion: Motion, frames: slice) -> Motion:
    """Some frames turned half around: arms and legs lead into another minimum."""
    angles, rotation = motion.angles.clone(), motion.rotation.clone()
    rotation[frames, 1] += torch.pi
    angles[frames] = angles[frames].flip(-1)
    return replace(motion, rotation=rotation, angles=angles)


def test_a_stretch_that_started_wrong_is_mended() -> None:
    take = make_take(60, views=2, lifted=False)
    problem = problem_of(take)
    hurried = replace(problem, config=replace(problem.config, max_steps=1))
    wrong, reports = track_motion(hurried, turned(take.truth, slice(20, 32)))
    found, after = mended(problem, wrong, reports)
    before = take.error_mm(take.actor.joints(wrong))[18:34].mean()
    assert before > 60, "the start was no trap"
    assert float(take.error_mm(take.actor.joints(found))[18:34].mean()) < 0.3 * float(before)
    for old, new in zip(reports, after, strict=True):
        assert old.window == new.window and new.energy <= old.energy


def test_a_motion_that_fits_stays_as_it_is() -> None:
    take = make_take(60, views=2, lifted=False)
    problem = problem_of(take)
    motion, reports = track_motion(problem, take.truth)
    found, after = mended(problem, motion, reports)
    assert float(take.error_mm(take.actor.joints(found)).max()) < 16
    assert sum(r.energy for r in after) <= sum(r.energy for r in reports)


def report(values: list[float], start: int = 0) -> WindowReport:
    window = Window(start, start + len(values))
    terms = {"joints2d": values}
    return WindowReport(window, Status.CONVERGED, 1, sum(values), {}, terms)


def test_runs_of_misfits_are_widened_and_single_frames_are_left() -> None:
    values = [1.0] * 30
    values[10] = values[11] = values[20] = 5.0
    bad = _misfits([report(values)], 30)
    assert torch.nonzero(bad).flatten().tolist() == list(range(6, 16))
    values[28] = values[29] = 5.0
    assert torch.nonzero(_misfits([report(values)], 30)).flatten().tolist()[-6:] == [*range(24, 30)]
    overlapping = [report([1.0] * 20), report([9.0] * 20, start=10)]
    assert bool(_misfits(overlapping, 30)[20:].all())
