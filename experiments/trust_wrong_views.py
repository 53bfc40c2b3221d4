"""Views that are wrong in a clip: are the frames named that come out bad, and no others?

For a third of the frames, or for all, and one view, joints lie aside, are of half a second later,
stand still, have left and right exchanged, or are pixels of an image of half the size; or left and
right are exchanged in every view. Checks of the inputs name some of these frames; trust is then
judged without the joints that they contradict.
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
from trust_model import bad_frames, shares

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
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
    """Of views that are wrong for a while and throughout, a row for each clip and set of views."""
    torch.set_num_threads(1)
    named = [
        balancing(config.data) if name == "balancing" else rendered_views(config.data, name)
        for name in config.sequences
    ]
    clips = [clip.part(views, config.frames) for clip in named for views in config.views]
    columns = (
        *("clip", "views", "frames", "bad"),
        *("bad named before, %", "good named before, %", "bad named, %", "good named, %"),
    )
    return Report(
        tuple(
            Table(
                f"frames named where a view is wrong {when}",
                columns,
                _rows(clips, config, whole),
                0,
            )
            for when, whole in (("for a while", False), ("throughout", True))
        )
    )


def _rows(
    clips: list[Recording], config: Experiment, throughout: bool
) -> tuple[tuple[str | int | float, ...], ...]:
    """One for each clip, and one for all."""
    judged = [torch.cat([*_judged(clip, throughout)], 1) for clip in clips]
    which = [(name, " ".join(map(str, v))) for name in config.sequences for v in config.views]
    rows = [(*names, *_row(each)) for names, each in zip(which, judged, strict=True)]
    return (*rows, ("all", "", *_row(torch.cat(judged, 1))))


def _row(judged: Tensor) -> tuple[int, int, float, float, float, float]:
    bad, before, now = judged
    return *shares(bad, before), *shares(bad, now)[2:]


def _judged(clip: Recording, throughout: bool) -> Iterator[Tensor]:
    """Frames that are bad, that are named without the checks, and with them, (3, F) bool."""
    seen: list[Trust] = []

    def kept(problem: ClipProblem, motion: Motion, joints: Motion | None = None) -> Trust:
        seen.append(judge_frames(frame_evidence(problem, motion)))
        return judge_motion(problem, motion, joints)

    for detections in _spoiled(clip, throughout):
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
        yield torch.stack((bad_frames(found.joints(), clip.truth), *named))


def _spoiled(clip: Recording, throughout: bool) -> Iterator[Detections]:
    """The clip with each mistake in the second third of its frames, or in all of them."""
    seen, count = clip.detections, clip.detections.frame_count
    part = slice(count // 3, 2 * count // 3)
    later = min(round(clip.rate / 2), count - part.stop)
    if throughout:
        part = slice(0, count - later)
    kept = part if throughout else slice(0, count)
    aside = 0.15 * seen.person_height()  # C
    changes: tuple[Callable[[Tensor, int], Tensor], ...] = (
        lambda joints, view: joints[part, view] + torch.stack((aside[view], 0 * aside[view])),
        lambda joints, view: joints[part.start + later : part.stop + later, view],
        lambda joints, view: joints[part.start, view].expand_as(joints[part, view]),
        lambda joints, view: joints[part, view][:, _MIRRORED],
        lambda joints, view: 0.5 * joints[part, view],
    )
    yield seen.frames(kept)
    for view in range(seen.views):
        for change in changes:
            joints = seen.joints2d.clone()
            joints[part, view] = change(seen.joints2d, view)
            yield replace(seen, joints2d=joints).frames(kept)
    joints = seen.joints2d.clone()
    joints[part] = joints[part][:, :, _MIRRORED]
    yield replace(seen, joints2d=joints).frames(kept)


if __name__ == "__main__":
    report.main(run, Experiment, "trust_wrong_views")
