"""Stretches of a clip in which a view is wrong: medians over all frames do not show them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import torch
from torch import Tensor

from perfcap.io.doctor.evidence import (
    BETTER,
    Scene,
    disagreement,
    frame_residuals,
    left_out_errors,
)
from perfcap.io.doctor.finding import Finding, Severity, ranges
from perfcap.io.doctor.hypotheses import Hypothesis, view_hypotheses

_WINDOW, _MOST = 10, 40  # frames, and of disjoint windows of a clip at most
_RAISED, _LEAST = 1.5, 0.02  # times what is usual in the clip, and of the person's height
# of the person's height: the lower quartile of a view's errors. Where one is hidden some joints are
# knocked aside, not all of them
_ASIDE = 0.07
_SHORTEST = 8  # frames; who hides another walks by faster
_HOLE = 3  # frames of a stretch that look well by chance
_CLOSE = 1.4  # times the least disagreement: mistakes that explain a part as well
_ALIKE = 1.5  # times the smallest leap: views that may be to blame as well


@dataclass(frozen=True)
class _Mistake:
    """What is wrong in which frames, and what to do; parts of a clip say it of the same remedy."""

    subject: str
    remedy: str
    what: str = field(compare=False)
    frames: frozenset[int] = field(compare=False)
    views: tuple[int, ...]
    vague: bool = field(default=False, compare=False)


def examine_stretches(
    scene: Scene, names: Sequence[str], height: float, *, alone: bool = True
) -> list[Finding]:
    """Views that are wrong in a part of the frames, where all views agree over the whole clip.

    They are warnings: the other frames are captured as well as ever.

    Args:
        scene: C views, (F, C), through ideal lenses, of joints seen with confidence.
        names: of the views.
        height: of the person, pixels.
        alone: whether nobody else is followed, so that following everybody may help.
    """
    found: dict[_Mistake, set[int]] = {}
    for mistake in _mistakes(_Views(scene, names, height), alone):
        found.setdefault(mistake, set()).update(mistake.frames)
    told: set[int] = set()
    findings = []
    # parts that reach into a stretch by a few frames may blame another view for them
    for each in sorted(found, key=lambda each: (each.vague, -len(found[each]))):
        frames = found[each]
        if 2 * len(frames & told) < len(frames):
            there = tuple(sorted(frames))
            what = f"{each.what} in frames {ranges(there)} (of the capture, counted from 0)"
            findings.append(
                Finding(Severity.WARNING, each.subject, what, each.remedy, there, each.views)
            )
            told |= frames
    return findings


@dataclass(frozen=True)
class _Views:
    """Views of a clip, with each mistake undone and with each view left out."""

    scene: Scene
    names: Sequence[str]
    height: float

    @cached_property
    def undone(self) -> list[tuple[Hypothesis, Scene]]:
        mistakes = view_hypotheses(self.names, range(len(self.names)))
        return [(each, each.undo(self.scene)) for each in mistakes]

    @cached_property
    def others(self) -> list[Scene]:
        """What is left without each view; nothing of two."""
        views = range(len(self.names))
        some = views if len(views) > 2 else ()
        return [self.scene.select([each for each in views if each != out]) for out in some]

    @cached_property
    def aside(self) -> list[Tensor]:
        """How far most joints of each view are off in each frame, (F,), of the person's height."""
        errors = (left_out_errors(self.scene, view) for view in range(len(self.names)))
        return [each.nanquantile(0.25, -1) / self.height for each in errors]

    def undoing(self, part: Tensor, enough: float) -> _Mistake | None:
        """A specific mistake without which a part disagrees by less than is enough, pixels."""
        left = [disagreement(changed.frames(part)) for _, changed in self.undone]
        lowest = min(range(len(left)), key=left.__getitem__)
        if left[lowest] >= enough:
            return None
        remedy = self.undone[lowest][0].remedy
        # exchanged sides of one view fit those of another, but not from one frame to the next
        alike = [
            (each, changed, self._where(changed, part))
            for (each, changed), rest in zip(self.undone, left, strict=True)
            if each.remedy == remedy and rest <= _CLOSE * left[lowest]
        ]
        best, _, frames = min(alike, key=lambda each: _leap(self._mended(*each[1:]), each[2]))
        if not self.others and len(best.views) < 2:  # it is unknown which of both is wrong
            return _Mistake(" or ".join(self.names), remedy, best.what, frames, (0, 1))
        return _Mistake(best.subject, remedy, best.what, frames, best.views)

    def _where(self, changed: Scene, part: Tensor) -> frozenset[int]:
        """Frames in and beside a part that fit better with a mistake undone."""
        return _around(frame_residuals(changed) < frame_residuals(self.scene), part)

    def _mended(self, changed: Scene, frames: frozenset[int]) -> Scene:
        """The clip with a mistake undone in some frames alone."""
        cameras, seen, other = changed.cameras, self.scene.detections, changed.detections
        there = torch.zeros(seen.frame_count, 1, 1, dtype=torch.bool)
        there[sorted(frames)] = True
        joints = torch.where(there[..., None], other.joints2d, seen.joints2d)
        confidence = torch.where(there, other.confidence2d, seen.confidence2d)
        mended = replace(seen, joints2d=joints, confidence2d=confidence)
        return Scene(cameras, mended)

    def elsewhere(self, part: Tensor, enough: float, alone: bool) -> _Mistake | None:
        """A view whose joints are elsewhere, without which a part disagrees by less."""
        apart = {
            view: _around(self.aside[view] > 0.5 * _ASIDE, part)
            for view, rest in enumerate(self.others)
            if disagreement(rest.frames(part)) < enough
            and float(self.aside[view][part].nanmedian()) > _ASIDE
        }
        leaps = {view: _leap(self.others[view], frames) for view, frames in apart.items()}
        view = min(apart, key=leaps.__getitem__, default=-1)
        if view < 0 or len(apart[view]) < _SHORTEST:
            return None
        near = [each for each in leaps if each != view and leaps[each] < _ALIKE * leaps[view]]
        rivals = " or ".join(self.names[each] for each in near)
        doubt = f" (or {rivals} does, which these views do not show)" if rivals else ""
        follow = " (--people follows everybody)" if alone else ""
        off = float(self.aside[view][sorted(apart[view])].nanmedian())
        return _Mistake(
            self.names[view],
            f"look whether its joints are of somebody else there{follow}, and whether the camera "
            "was moved or lost frames; capture the frames before and after one at a time "
            "(--frames), or leave the view out",
            f"sees the person {off:.0%} of their height or more from where the other views see "
            f"them{doubt}",
            apart[view],
            (view, *near),
            vague=True,
        )


def _mistakes(views: _Views, alone: bool) -> Iterator[_Mistake]:
    """One of each part of the clip in which views disagree more than usual, if it is explained."""
    common = views.scene.common()  # a part of few frames that are seen may be wrong by chance
    parts = [common[part] for part in _parts(len(common))]
    seen = [disagreement(views.scene.frames(part)) for part in parts]
    known = sorted(each for each in seen if math.isfinite(each))
    # of the better quarter: more than half of the clip may be wrong
    usual = known[(len(known) - 1) // 4] if known else math.inf
    raised = max(_RAISED * usual, _LEAST * views.height)
    for part, now in zip(parts, seen, strict=True):
        if raised < now < math.inf:
            # without a specific mistake the part is like the others
            mistake = views.undoing(part, min(BETTER * now, raised))
            mistake = mistake or views.elsewhere(part, BETTER * now, alone)
            if mistake is not None:
                yield mistake


def _parts(count: int) -> list[Tensor]:
    """Frames (N,) of overlapping parts of a clip; none of one that is hardly longer."""
    length = max(_WINDOW, count // _MOST)
    if count < 2 * length:
        return []
    starts = [*range(0, count - length, length // 2), count - length]
    return [torch.arange(start, start + length) for start in starts]


def _leap(scene: Scene, frames: frozenset[int]) -> float:
    """How far joints leap into or out of a stretch, m.

    Two views that are level with each other agree whatever one of them shows, but not that the
    person leaps where it begins. A leap shows in two second differences, the slip of one frame in
    three.
    """
    count = scene.detections.frame_count
    leaps = []
    for edge in (min(frames), max(frames) + 1):
        near = torch.arange(max(0, edge - 3), min(count, edge + 3))
        if len(near) < 4:
            continue
        points, _ = scene.frames(near).triangulated(rounds=6)
        bends = points.diff(n=2, dim=0).norm(dim=-1).nanmedian(-1).values.nan_to_num(0.0)
        leaps.append(float(torch.minimum(bends[1:], bends[:-1]).max()))
    return max(leaps, default=0.0)


def _around(wrong: Tensor, part: Tensor) -> frozenset[int]:
    """The frames that are wrong (F,), in a part and on beside it without a long hole."""
    inside = [int(frame) for frame in part if wrong[frame]] or part.tolist()
    first, last = inside[0], inside[-1]
    frames = wrong.nonzero()[:, 0].tolist()
    for frame in frames:
        last = frame if last < frame <= last + _HOLE else last
    for frame in reversed(frames):
        first = frame if first - _HOLE <= frame < first else first
    return frozenset(range(first, last + 1))
