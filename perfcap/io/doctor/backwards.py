"""Whether a part of the frames came in the opposite order, as of a video that was cut so."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity, ranges

_SURE = 0.3  # confidence
_SHORTEST = 8  # frames of a part, and of the others
_JOINTS = 6  # seen in two frames, that say how far apart these are
_LEAP, _SMOOTH = 3.0, 2.0  # times the usual step: at the edges as given, and the other way round
_EDGES = 40  # frames with the longest steps that are looked at


def examine_backwards(
    name: str,
    view: int,
    joints: Tensor,
    confidence: Tensor,
    mirrored: Sequence[int] | None = None,
) -> list[Finding]:
    """Frames between two leaps, of which the first goes on after the part and the last before it.

    Nothing shows a whole clip that runs backwards, nor a part that begins or ends with it.

    Args:
        name: of the view.
        view: its number.
        joints: in an image or in space, (F, 16, D).
        confidence: (F, 16).
        mirrored: index of each joint's counterpart on the other side, where a detector may have
            taken one for the other: such a leap is none of the person.
    """
    sure = confidence > _SURE
    if len(joints) < 3 * _SHORTEST:
        return []
    steps = _apart(joints[1:], joints[:-1], sure[1:] & sure[:-1])
    usual = float(steps.nanmedian())
    # one frame that is elsewhere has a leap on either side
    beside = torch.maximum(steps[:-2].nan_to_num(), steps[2:].nan_to_num())
    far = steps > _LEAP * usual
    if mirrored is not None:
        moved = _apart_of_either(joints[1:], joints[:-1], sure[1:] & sure[:-1], mirrored)
        far &= moved > _LEAP * usual
    alone = far[1:-1] & (steps[1:-1] > _SMOOTH * beside)
    leaps = (alone.nonzero().flatten() + 2).tolist()  # into these frames
    leaps = sorted(sorted(leaps, key=lambda frame: -float(steps[frame - 1]))[:_EDGES])
    frames: list[int] = []
    for start, stop in combinations(leaps, 2):
        if stop - start < _SHORTEST or start in frames:
            continue
        before, after = torch.tensor([start - 1, start]), torch.tensor([stop - 1, stop])
        crossed = _apart(joints[before], joints[after], sure[before] & sure[after])
        if bool((crossed < _SMOOTH * usual).all()):
            frames += range(start, stop)
    if not frames:
        return []
    what = (
        f"frames {ranges(frames)} (of the capture, counted from 0) look as if played backwards: "
        "joints leap where they begin and end, and would not the other way round"
    )
    remedy = "give them in the order in which they were recorded"
    return [Finding(Severity.WARNING, name, what, remedy, tuple(frames), (view,))]


def _apart(one: Tensor, other: Tensor, both: Tensor) -> Tensor:
    """Median distance of joints (N, 16, D) that both frames show, (N,); NaN where few do."""
    return _median((one - other).norm(dim=-1), both)


def _apart_of_either(one: Tensor, other: Tensor, both: Tensor, mirrored: Sequence[int]) -> Tensor:
    """The same of joints, each from the nearer one of both sides."""
    own, opposite = ((one - side).norm(dim=-1) for side in (other, other[:, list(mirrored)]))
    return _median(torch.minimum(own, opposite), both)


def _median(distances: Tensor, both: Tensor) -> Tensor:
    apart = torch.where(both, distances, torch.nan).nanmedian(-1).values
    return torch.where(both.sum(-1) >= _JOINTS, apart, torch.nan)
