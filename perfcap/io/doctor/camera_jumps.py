"""Poses of a moving camera that are of no camera's way: unsolved images, slips, and steps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby

import torch
from torch import Tensor

from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.finding import Finding, Severity, ranges
from perfcap.io.doctor.ways import given_ways

_TURN, _SHIFT = math.radians(4), 0.3  # m; a hand does not shake by so much within one frame
_TIMES = 10.0  # what is usual; the largest of 10 000 normal departures is 3 times their median
_AROUND = 25  # frames, whose median is usual as well: who runs after standing shakes for a while
_EXACT = 1e-6  # entries of rotations, and metres
_SHORT = 12  # frames; a shot by a camera that stands at the origin is longer


def examine_poses(rig: CameraRig, first: int = 0) -> Iterator[Finding]:
    """Frames in which a moving camera is somewhere else, as no camera moves.

    Speed that changes is motion. A step that stays is a cut, or a stretch that was solved wrongly:
    the file does not say which.

    Args:
        rig: C views.
        first: number of the first pose, as users count frames.
    """
    for way in given_ways(rig):
        view, name, turns, places = way.view, way.name, way.rotation, way.centre
        lost = _unsolved(turns, places)
        if lost:
            what = (
                f"its pose is the identity at the origin in frames {_listed(lost, first)}, far "
                "from the poses beside"
            )
            remedy = (
                "programs write that of images they have not solved: solve them, or give them poses"
                " between their neighbours'"
            )
            yield Finding(Severity.WARNING, name, what, remedy, tuple(lost), (view,))
        kept = torch.tensor(sorted(set(range(len(turns))) - set(lost)))
        poses = turns[kept], places[kept]
        slipped = _slipped(*poses)
        if slipped.any():
            about = _about_slips(name, *poses, slipped, kept, first)
            yield replace(about, views=(view,))
        poses = turns[kept][~slipped], places[kept][~slipped]
        yield from _steps(name, *poses, kept[~slipped] + first)


def _listed(frames: list[int], first: int) -> str:
    return ranges([first + frame for frame in frames])


def _unsolved(turns: Tensor, places: Tensor) -> list[int]:
    """Frames of exact identities at the origin, in short stretches far from what is beside them."""
    eye = torch.eye(3).to(turns)
    plain = ((turns - eye).abs().amax((-2, -1)) < _EXACT) & (places.abs().amax(-1) < _EXACT)
    if not plain.any() or 2 * int(plain.sum()) >= len(plain):
        return []
    others = turns[~plain], places[~plain]
    turn, shift = _between(*(each[:-1] for each in others), *(each[1:] for each in others))
    away = _between(turns, places, eye.expand_as(turns), torch.zeros_like(places))
    far = (away[0] > _least(turn, _TURN)) | (away[1] > _least(shift, _SHIFT))
    found: list[int] = []
    for is_plain, group in groupby(range(len(plain)), plain.tolist().__getitem__):
        run = list(group)
        beside = [frame for frame in (run[0] - 1, run[-1] + 1) if 0 <= frame < len(plain)]
        if is_plain and len(run) < _SHORT and bool(far[beside].all()):
            found += run
    return found


def _least(usual: Tensor, far: float) -> float:
    """The least difference that is far, in radians or metres, where some differences are usual."""
    return max(far, _TIMES * float(usual.median())) if len(usual) else far


def _departures(turns: Tensor, places: Tensor) -> tuple[Tensor, Tensor]:
    """Of the inner poses from the middle of their neighbours, rad and m, (F - 2,) each."""
    before, after = (turns[:-2], places[:-2]), (turns[2:], places[2:])
    half = 0.5 * matrix_to_rotvec(before[0].mT @ after[0])
    middle = before[0] @ rotvec_to_matrix(half), 0.5 * (before[1] + after[1])
    return _between(turns[1:-1], places[1:-1], *middle)


def _slipped(turns: Tensor, places: Tensor) -> Tensor:
    """Frames whose pose is far from the middle of its neighbours', which are near each other."""
    found = torch.zeros(len(turns), dtype=torch.bool)
    if len(turns) < 3:
        return found
    gaps = _between(turns[:-2], places[:-2], turns[2:], places[2:])
    for departure, gap, far in zip(_departures(turns, places), gaps, (_TURN, _SHIFT), strict=True):
        large = (departure > far) & (departure > _TIMES * _usual(departure))
        found[1:-1] |= large & (2 * gap < departure)
    return found


def _about_slips(
    name: str, turns: Tensor, places: Tensor, slipped: Tensor, kept: Tensor, first: int
) -> Finding:
    departures, away = _departures(turns, places), slipped[1:-1]
    degrees, metres = math.degrees(float(departures[0][away].max())), departures[1][away].max()
    usual = math.degrees(float(departures[0].median())), departures[1].median()
    frames = kept[slipped].tolist()
    what = (
        f"its pose jumps away and back in frames {_listed(frames, first)}, by up to "
        f"{degrees:.1f} degrees and {metres:.2f} m from between its neighbours; {usual[0]:.2g} "
        f"degrees and {usual[1]:.2g} m are usual"
    )
    remedy = "solve the camera again there, or give these frames poses between their neighbours'"
    return Finding(Severity.WARNING, name, what, remedy, tuple(frames))


def _steps(name: str, turns: Tensor, places: Tensor, numbers: Tensor) -> Iterator[Finding]:
    """Frames before which a pose is far from the last one, though it hardly moves beside."""
    if len(turns) < 4:
        return
    steps = _between(turns[:-1], places[:-1], turns[1:], places[1:])
    found = torch.zeros(len(turns) - 1, dtype=torch.bool)
    for step, far in zip(steps, (_TURN, _SHIFT), strict=True):
        beside = torch.maximum(step[:-2], step[2:])
        large = (step > far) & (step > _TIMES * _usual(step))
        found[1:-1] |= large[1:-1] & (2 * beside < step[1:-1])
    if not found.any():
        return
    degrees, metres = math.degrees(float(steps[0][found].max())), steps[1][found].max()
    what = (
        f"its pose steps by up to {degrees:.1f} degrees and {metres:.2f} m before frames "
        f"{ranges(numbers[1:][found].tolist())}, and hardly moves beside"
    )
    remedy = (
        "if the video is cut there, capture one shot at a time (--frames A:B); else solve the "
        "camera again from there"
    )
    yield Finding(Severity.WARNING, name, what, remedy)


def _between(turns: Tensor, places: Tensor, others: Tensor, there: Tensor) -> tuple[Tensor, Tensor]:
    """Angle, rad, and distance, m, between poses, (F,) each."""
    angle: Tensor = matrix_to_rotvec(turns.mT @ others).norm(dim=-1)
    return angle, (places - there).norm(dim=-1)


def _usual(departure: Tensor) -> Tensor:
    """The median of all frames, or of those around each if that is more, (F,)."""
    count = len(departure)
    wide = min(_AROUND, count)
    around = departure.unfold(0, wide, 1).median(-1).values
    start = (torch.arange(count) - wide // 2).clamp(0, count - wide)
    return around[start].clamp(min=float(departure.median()))
