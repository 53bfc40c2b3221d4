"""Single poses of a moving camera that are of no camera's way: unsolved images, and slips."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby

import torch
from torch import Tensor

from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.finding import Finding, Severity, ranges

_TURN, _SHIFT = math.radians(4), 0.3  # m; a hand does not shake by so much within one frame
_TIMES = 10.0  # what is usual; the largest of 10 000 normal departures is 3 times their median
_AROUND = 25  # frames, whose median is usual as well: who runs after standing shakes for a while
_EXACT = 1e-6  # entries of rotations, and metres
_SHORT = 12  # frames; a shot by a camera that stands at the origin is longer


def examine_poses(rig: CameraRig, first: int = 0) -> Iterator[Finding]:
    """Frames in which a moving camera is somewhere else, as no camera moves.

    A step that stays is a cut, and speed that changes is motion: neither comes back to where it
    was within a frame.

    Args:
        rig: C views.
        first: number of the first pose, as users count frames.
    """
    if rig.cameras.intrinsics.dim() != 4:
        return
    for view, name in enumerate(rig.names):
        turns, places = rig.cameras.rotation[:, view], rig.cameras.centre[:, view]
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
            yield Finding(Severity.WARNING, name, what, remedy)
        kept = torch.tensor(sorted(set(range(len(turns))) - set(lost)))
        yield from _slips(name, turns[kept], places[kept], kept + first)


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


def _slips(name: str, turns: Tensor, places: Tensor, numbers: Tensor) -> Iterator[Finding]:
    """Frames whose pose is far from the middle of its neighbours', which are near each other."""
    if len(turns) < 3:
        return
    before, after = (turns[:-2], places[:-2]), (turns[2:], places[2:])
    half = 0.5 * matrix_to_rotvec(before[0].mT @ after[0])
    middle = before[0] @ rotvec_to_matrix(half), 0.5 * (before[1] + after[1])
    departures = _between(turns[1:-1], places[1:-1], *middle)
    gaps = _between(*before, *after)
    turned, shifted = (
        (departure > far) & (departure > _TIMES * _usual(departure)) & (2 * gap < departure)
        for departure, gap, far in zip(departures, gaps, (_TURN, _SHIFT), strict=True)
    )
    away = turned | shifted
    if not away.any():
        return
    degrees, metres = math.degrees(float(departures[0][away].max())), departures[1][away].max()
    usual = math.degrees(float(departures[0].median())), departures[1].median()
    what = (
        f"its pose jumps away and back in frames {ranges(numbers[1:-1][away].tolist())}, by up to "
        f"{degrees:.1f} degrees and {metres:.2f} m from between its neighbours; {usual[0]:.2g} "
        f"degrees and {usual[1]:.2g} m are usual"
    )
    remedy = "solve the camera again there, or give these frames poses between their neighbours'"
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
