"""Parts of a clip in which left and right, or near and far, are the opposite of what they are."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity, ranges
from perfcap.io.doctor.sides import AHEAD, across, alike, bearings, exchanges, of_sides

_NEAR, _FEWEST = 5, 3  # frames beside an edge whose medians are compared, and of them at its ends
# correlation of directions before and after an edge: of all sides, and of three that points show
_TURNED, _CLEARLY = -0.3, -0.4
_AROUND, _SAYING = 8, 3  # frames beside an edge that are judged, and how many must say something
_SHORTEST, _ENOUGH = 8, 5  # frames of a part, and how many of them must say something
_MOST, _BESIDE = 0.75, 0.6  # share of those that say the same in a part, and beside an edge
_SURE = 0.3  # confidence
_ARMS, _LEGS = (1, 2, 3), (0, 4, 5)  # of the pairs that ``across`` gives
_REMEDY = "exchange the names of left and right there, or capture one part at a time (--frames)"
_DEPTH = "3D joints are in camera axes, z away from the camera: give them so in every frame"
# Of one view alone: one who is seen from the side turns over by next to nothing
_CROSSED, _LIMB, _APART = 0.3, 0.5, 0.02  # shares of the way as named, and of the height
_LIMBS = 5  # of six pairs


def examine_turned_poses(
    name: str, view: int, pixels: Tensor, confidence: Tensor, pose: Tensor, trusted: Tensor
) -> list[Finding]:
    """Frames whose 3D poses are mirror images, of a view whose other frames are right.

    Toes point backwards in them, or hips lie the other way than shoulders; and at their first or
    last frame the joints turn over: sides in 2D, where there is any, and 3D, or near and far in 3D.

    Args:
        name: of the view.
        view: its number.
        pixels: its joints, (F, 16, 2).
        confidence: of the joints, (F, 16).
        pose: in camera axes, (F, 16, 3), metres.
        trusted: frames of which there is a pose, (F,), bool.
    """
    points = torch.where(trusted[:, None, None], pose, torch.nan)
    shown = torch.where((confidence > _SURE)[..., None], pixels, torch.nan)
    alone = not bool((confidence > 0).any())  # 3D poses of who gives no pixels
    sides = [across(points)] if alone else [across(shown), across(points)]
    ahead, level = bearings(points)
    whole = _parts(sides, ahead)
    what = f"left and right look exchanged in {'3D' if alone else '2D and 3D'}"
    findings = _finding(name, what, _REMEDY, whole, (view,))
    depth = points[..., 2:] - points[..., 2:].mean(1, keepdim=True)
    deep = [] if whole else _parts([depth], ahead)
    what, remedy = "the depth of 3D poses looks negated, so that feet point backwards,", _DEPTH
    if not all(_go_on(sides[-1][..., :2], part) for part in deep):
        # of one who stands sideways, images hardly show which
        what = "3D poses look like mirror images, sides exchanged or depth negated,"
        remedy = f"{_REMEDY}; or {_DEPTH}"
    findings += _finding(name, what, remedy, deep, (view,))
    for limbs, which in (("arms", _ARMS), ("legs", _LEGS)):
        parts = _parts([each[:, list(which)] for each in sides], level)
        what = f"left and right of the {limbs} look exchanged"
        findings += _finding(name, what, _REMEDY, parts, (view,))
    return findings


def examine_turned_limbs(
    subject: str, pixels: Tensor, known: Tensor, points: Tensor
) -> list[Finding]:
    """Frames in which arms or legs alone are exchanged in all views, so that hips lie the other way
    than shoulders, and at whose first or last frame they turn over in the world and in the images.

    Args:
        subject: of the finding.
        pixels: joints in C views, (F, C, 16, 2).
        known: which of them count, (F, C, 16).
        points: the same in the world, (F, 16, 3), NaN where unknown.
    """
    shown = across(torch.where(known[..., None], pixels, torch.nan))
    sides, (_, level) = across(points), bearings(points)
    findings = []
    for limbs, which in (("arms", _ARMS), ("legs", _LEGS)):
        # where one view alone turns over, the points are nowhere
        seen = shown[:, :, list(which)].flatten(1, 2)
        parts = _parts([sides[:, list(which)], seen], level, _CLEARLY)
        what = f"left and right of the {limbs} look exchanged in every view"
        findings += _finding(subject, what, _REMEDY, parts, range(pixels.shape[1]))
    return findings


def examine_turned_view(name: str, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Left and right of nearly all limbs that change places between two frames, and stay so.

    Nothing else says which of the frames are wrong where there is one view and no 3D pose.

    Args:
        name: of the view.
        pixels: its joints, (F, 16, 2).
        confidence: of the joints, (F, 16).
    """
    known = confidence > _SURE
    shown = torch.where(known[..., None], pixels, torch.nan)
    rows = shown[..., 1]
    tall = rows.nan_to_num(-torch.inf).amax(1) - rows.nan_to_num(torch.inf).amin(1)
    tall = tall[known.sum(1) >= _AROUND]
    if not len(tall):
        return []
    height = float(tall.median())
    edges = exchanges(pixels[:, None], known[:, None], 1)
    edges = [edge for edge in edges if _changed(shown, edge, height)]
    if not edges:
        return []
    what = (
        f"left and right change places at frame {ranges(edges)} (of the capture, counted from 0): "
        "nearly all limbs turn over from one frame to the next"
    )
    return [Finding(Severity.WARNING, name, what, _REMEDY)]


def _changed(shown: Tensor, edge: int, height: float) -> bool:
    """Whether joints (F, 16, 2) go on far nearer to those of the other side, NaN where unknown."""
    before = shown[edge - _FEWEST : edge].nanmedian(0).values
    after = shown[edge : edge + _FEWEST].nanmedian(0).values
    (left, right), (left_then, right_then) = (of_sides(each) for each in (after, before))
    straight = (left - left_then).norm(dim=-1) + (right - right_then).norm(dim=-1)
    crossed = (left - right_then).norm(dim=-1) + (right - left_then).norm(dim=-1)
    apart = torch.minimum((left - right).norm(dim=-1), (left_then - right_then).norm(dim=-1))
    limbs = (crossed < _LIMB * straight) & (apart > _APART * height)
    total = float(crossed.nansum()) < _CROSSED * float(straight.nansum())
    return total and int(limbs.sum()) >= _LIMBS


def _go_on(directions: Tensor, part: tuple[int, int]) -> bool:
    """Whether directions (F, N, D) stay as they are where a part begins, or else ends."""
    edge = part[0] or part[1]
    return _alike_beside(directions, edge) > -_TURNED


def _parts(
    directions: Sequence[Tensor], says: Tensor, turned: float = _TURNED
) -> list[tuple[int, int]]:
    """Half-open ranges of frames that are wrong, each beside an edge at which all turn over.

    Args:
        directions: (F, N, D) each, NaN where unknown.
        says: of each frame, 1 that it is right to -1 that it is the opposite, (F,); NaN of
            nothing.
        turned: correlation beside an edge, at most.
    """
    edges = _edges(directions, says, turned)
    if not edges:
        return []
    parts = [_said(says, start, stop) for start, stop in pairwise([0, *edges, len(says)])]
    return [
        (start, stop)
        for start, stop in parts
        if stop - start >= _SHORTEST and _verdict(says[start:stop], _ENOUGH) < 0
    ]


def _said(says: Tensor, start: int, stop: int) -> tuple[int, int]:
    """Frames from one to another without those at either end of which nothing is said for long."""
    against = (says[start:stop] < -AHEAD).nonzero()[:, 0].tolist() or [0]
    first, last = start + against[0], start + against[-1] + 1
    return (
        first if first - start >= _SHORTEST else start,
        last if stop - last >= _SHORTEST else stop,
    )


def _edges(directions: Sequence[Tensor], says: Tensor, turned: float) -> list[int]:
    """Frames that say the opposite of those before, and at which all directions turn over."""
    found = []
    for frame in range(_FEWEST, len(says) - _FEWEST + 1):
        before, after = says[max(0, frame - _AROUND) : frame], says[frame : frame + _AROUND]
        if _verdict(before, _SAYING, _BESIDE) * _verdict(after, _SAYING, _BESIDE) >= 0:
            continue
        alikes = [_alike_beside(each, frame) for each in directions]
        if all(each < turned for each in alikes):
            at_once = [alike(each[frame - 1], each[frame]) for each in directions]
            clear = [each for each in (*alikes, *at_once) if not math.isnan(each)]
            found.append((sum(clear), frame))
    best: list[int] = []
    for _, frame in sorted(found):
        if all(abs(frame - other) >= _SHORTEST for other in best):
            best.append(frame)
    return sorted(best)


def _alike_beside(directions: Tensor, frame: int) -> float:
    """Correlation of directions (F, N, D) before and from a frame on; single ones may be wrong."""
    before = directions[max(0, frame - _NEAR) : frame].nanmedian(0).values
    return alike(before, directions[frame : frame + _NEAR].nanmedian(0).values)


def _finding(
    subject: str,
    what: str,
    remedy: str,
    parts: Sequence[tuple[int, int]],
    views: Iterable[int],
) -> list[Finding]:
    """Of all parts together; none of no part."""
    if not parts:
        return []
    frames = tuple(frame for part in parts for frame in range(*part))
    what = f"{what} in frames {ranges(frames)} (of the capture, counted from 0)"
    return [Finding(Severity.WARNING, subject, what, remedy, frames, tuple(views))]


def _verdict(says: Tensor, fewest: int, most: float = _MOST) -> int:
    """What most frames (N,) say that say something: 1 right, -1 the opposite; else 0."""
    against, right = int((says < -AHEAD).sum()), int((says > AHEAD).sum())
    if against + right < fewest:
        return 0
    share = against / (against + right)
    return -1 if share > most else 1 if share < 1 - most else 0
