"""Views that are wrong in a part of a clip: are the frames named that come out bad, and no others?

For a third of the frames and one view, joints lie aside, are of half a second later, stand still,
have left and right exchanged, or are pixels of an image of half the size; or left and right are
exchanged in every view. Checks of the inputs name some of these frames; trust is then judged
without the joints that they contradict.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import report
import torch
from recordings import Recording, balancing, rendered_views
from report import Report, Table
from torch import Tensor
from trust import FAR, OFF, shares

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.alignment import procrustes
from perfcap.metrics.alignment import root_aligned
from perfcap.pipeline import move
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.stage import Stage
from perfcap.pipeline.trust import THRESHOLD, Trust, frame_evidence, judge_frames, judge_motion

_MIRRORED = list(LANDMARKS16.mirrored())


@dataclass(frozen=True)
class Experiment:
    """What to run."""

    data: Path = report.DATA
    """Folder of the recordings."""
    sequences: tuple[str, ...] = ("dev_views", "dev_dance", "balancing")
    """Rendered ones in several views, and the real man."""
    views: tuple[tuple[int, ...], ...] = ((0, 2), (0, 1, 2), (0, 2, 3), (0, 1, 2, 3))
    """Of each that are taken together."""
    frames: int = 60
    """Of a clip, at most."""


def run(config: Experiment) -> Report:
    """A row for each clip and set of views, and one for all."""
    torch.set_num_threads(1)
    rows: list[tuple[str | int | float, ...]] = []
    sums = []
    for name in config.sequences:
        clip = balancing(config.data) if name == "balancing" else rendered_views(config.data, name)
        for views in config.views:
            judged = torch.cat([*_judged(_part(clip, list(views), config.frames))], 1)
            sums.append(judged)
            rows.append((name, " ".join(map(str, views)), *_row(judged)))
    rows.append(("all", "", *_row(torch.cat(sums, 1))))
    columns = (
        *("clip", "views", "frames", "bad"),
        *("bad named before, %", "good named before, %", "bad named, %", "good named, %"),
    )
    return Report((Table("frames named where a view is wrong", columns, tuple(rows), 0),))


def _row(judged: Tensor) -> tuple[int, int, float, float, float, float]:
    bad, before, now = judged
    return *shares(bad, before), *shares(bad, now)[2:]


def _part(clip: Recording, views: list[int], frames: int) -> Recording:
    count = slice(0, min(frames, clip.detections.frame_count))
    seen = clip.detections.select(views).frames(count)
    return replace(clip, rig=clip.rig.select(views), detections=seen, truth=clip.truth[count])


def _judged(clip: Recording) -> Iterator[Tensor]:
    """Frames that are bad, that are named without the checks, and with them, (3, F) bool."""
    seen: list[Trust] = []

    def kept(problem: ClipProblem, motion: Motion, joints: Motion | None = None) -> Trust:
        seen.append(judge_frames(frame_evidence(problem, motion)))
        return judge_motion(problem, motion, joints)

    for detections in _spoiled(clip):
        with mock.patch.object(move, "judge_motion", kept), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = capture(
                clip.actor,
                clip.cameras,
                detections,
                clip.rate,
                until=Stage.TRACK_MOTION,
                solve_bones=clip.name == "balancing",
                workers=1,
            )
        assert found.trust is not None
        named = (each.value < THRESHOLD for each in (seen[-1], found.trust))
        yield torch.stack((_bad(found.joints(), clip.truth), *named))


def _bad(joints: Tensor, truth: Tensor) -> Tensor:
    """Frames (F,) as ``trust.py`` has it."""
    known = truth.isfinite().all(-1).all(0)
    worst = (root_aligned(joints) - root_aligned(truth)).norm(dim=-1)[:, known].amax(-1)
    joints, truth = joints[:, known], truth[:, known]
    error = (procrustes(joints, truth, scale=True).apply(joints) - truth).norm(dim=-1).mean(-1)
    bad: Tensor = (error > FAR) | (worst > OFF)
    return bad


def _spoiled(clip: Recording) -> Iterator[Detections]:
    """The clip with each mistake in the second third of its frames."""
    seen = clip.detections
    part = slice(seen.frame_count // 3, 2 * seen.frame_count // 3)
    later = min(round(clip.rate / 2), seen.frame_count - part.stop)
    aside = 0.15 * seen.person_height()  # C
    changes: tuple[Callable[[Tensor, int], Tensor], ...] = (
        lambda joints, view: joints[part, view] + torch.stack((aside[view], 0 * aside[view])),
        lambda joints, view: joints[part.start + later : part.stop + later, view],
        lambda joints, view: joints[part.start, view].expand_as(joints[part, view]),
        lambda joints, view: joints[part, view][:, _MIRRORED],
        lambda joints, view: 0.5 * joints[part, view],
    )
    yield seen
    for view in range(seen.views):
        for change in changes:
            joints = seen.joints2d.clone()
            joints[part, view] = change(seen.joints2d, view)
            yield replace(seen, joints2d=joints)
    joints = seen.joints2d.clone()
    joints[part] = joints[part][:, :, _MIRRORED]
    yield replace(seen, joints2d=joints)


if __name__ == "__main__":
    report.main(run, Experiment, "trust_wrong_views")
