"""Parts of a clip in which one joint of both sides is exchanged: bones that cross are too long."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity, ranges
from perfcap.io.doctor.pairs import BONES, bone_lengths, exchange

# of 80 sets of views and 12 runs of 3D poses of recorded people none is named, nor at 1.15
_LONG, _LIKE = 1.2, 0.12  # of a joint's bones: as named at least, and crosswise from the usual
_SHORTEST, _HOLE = 8, 3  # frames of a part, and between frames that show it
_MOST, _WHOLE = 0.6, 0.9  # of the frames of a part, and of a clip
_REMEDY = "exchange their names there, or capture one part at a time (--frames)"


def examine_crossed_parts(subject: str, points: Tensor, views: Iterable[int]) -> list[Finding]:
    """Wrists, elbows, toes, ankles or knees that are each other's in some frames.

    Args:
        subject: of the finding.
        points: landmarks (F, 16, 3) in the world or in the axes of a camera, metres, NaN where
            unknown.
        views: that are wrong then.
    """
    findings: list[Finding] = []
    left = list(BONES)
    while undone := {name: found for name in left if (found := _undone(name, points)) is not None}:
        # a knee that is exchanged makes ankles look so
        best = min(undone, key=lambda name: _looseness(undone[name][0]))
        points, frames = undone[best]
        left.remove(best)
        what = (
            f"l_{best} and r_{best} look exchanged in frames {ranges(frames)} (of the capture, "
            "counted from 0): the bones that end there have their lengths crosswise"
        )
        findings.append(Finding(Severity.WARNING, subject, what, _REMEDY, frames, tuple(views)))
    return findings


def _undone(name: str, points: Tensor) -> tuple[Tensor, tuple[int, ...]] | None:
    """Points without an exchange of a joint, and the frames of it; None where there is none."""
    parts = _parts(*(bone_lengths(name, points, sides).sum(-1) for sides in ("lr", "rl")))
    frames = [frame for part in parts for frame in range(*part)]
    if not 0 < len(frames) < _WHOLE * len(points):  # of more, ``examine_pairs`` says so
        return None
    changed = points.clone()
    changed[frames] = exchange((name,), points[frames])
    return changed, tuple(frames)


def _looseness(points: Tensor) -> float:
    """How much all bones change their lengths, metres."""
    lengths = torch.cat([bone_lengths(name, points, "lr") for name in BONES], -1)
    return float((lengths - lengths.nanmedian(0).values).abs().nanmean(0).nansum())


def _parts(named: Tensor, crossed: Tensor) -> list[tuple[int, int]]:
    """Half-open ranges of frames in which bones (F,) m are as long as usual the other way alone."""
    least = torch.minimum(named, crossed)
    usual = float(least.nanmedian())
    wrong = (named > _LONG * usual) & ((crossed - usual).abs() < _LIKE * usual)
    parts: list[list[int]] = []
    for frame in wrong.nonzero().flatten().tolist():
        if parts and frame <= parts[-1][1] + _HOLE:
            parts[-1][1] = frame + 1
        else:
            parts.append([frame, frame + 1])
    return [
        (start, stop)
        for start, stop in parts
        if stop - start >= _SHORTEST and float(wrong[start:stop].double().mean()) > _MOST
    ]
