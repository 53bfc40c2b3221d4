"""Joints that go along lines or splines for a while, as where gaps or keys were interpolated."""

from __future__ import annotations

from collections import Counter
from itertools import chain

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.body_size import body_size
from perfcap.io.doctor.finding import Finding, Severity, counted, ranges

_SHORTEST, _LONG = 4, 8  # frames of a line, without its ends; and of those that are named alone
_FEWEST, _SHARE = 8, 0.1  # frames of one joint on lines, and share of those that show it
# Shares of the person's size: from a line, to the last digits of a file; of the kink at an end of
# it; and between its ends: a joint that stays is none
_OFF, _KINK, _MOVED = 5e-5, 5e-4, 0.01
_COARSE = 5  # times _OFF: where all places are so far apart, they were rounded, and lines are so
_SOME = 4  # joints on lines, with which a frame is not to be trusted
_NAMED = 4  # joints in words
_ORDERS = 2, 4  # of differences that are 0 on lines, and on the cubics of splines


def examine_straight(
    subject: str, view: int, joints: Tensor, known: Tensor, what: str = "joints"
) -> list[Finding]:
    """Joints that follow a line or a cubic to the last digit, and then another: no detector's do.

    Args:
        subject: of the finding.
        view: its number.
        joints: landmarks (F, 16, D), in pixels or metres.
        known: which of them count, (F, 16).
        what: they are called.
    """
    known = known & joints.isfinite().all(-1)
    size = body_size(joints, known)
    if len(joints) < _SHORTEST + 3 or size is None or _rounded(joints[known], _OFF * size):
        return []
    places = torch.where(known[..., None], joints / size, torch.nan)
    bends = [places.diff(n=order, dim=0).norm(dim=-1).mT.tolist() for order in _ORDERS]
    lines = [
        _merged(_lines(straight, place, 0), _lines(curved, place, 1))
        for straight, curved, place in zip(*bends, places.unbind(1), strict=True)
    ]
    counts = known.sum(0).tolist()
    filled = [
        joint
        for joint, found in enumerate(lines)
        if sum(map(len, found)) >= max(_FEWEST, _SHARE * counts[joint])
        or any(len(each) >= _LONG for each in found)
    ]
    if not filled:
        return []
    frames = sorted({frame for joint in filled for each in lines[joint] for frame in each})
    names = ", ".join(
        f"{LANDMARKS[joint]} ({counted(sum(map(len, lines[joint])))})" for joint in filled[:_NAMED]
    )
    names += f" and {len(filled) - _NAMED} more" if len(filled) > _NAMED else ""
    said = (
        f"{what} move along straight lines or splines to the last digit, {names}, in frames "
        f"{ranges(frames)} (of the capture, counted from 0)"
    )
    remedy = (
        "no detector's do; were gaps or the frames between keys interpolated? Give confidence 0 "
        "(3D joints NaN) to what was not found: the motion is solved there"
    )
    joints_on = Counter(frame for found in lines for frame in set(chain.from_iterable(found)))
    many = [frame for frame in frames if joints_on[frame] >= _SOME]
    views = (view,) if many else ()
    return [Finding(Severity.WARNING, subject, said, remedy, tuple(many), views)]


def _rounded(places: Tensor, step: float) -> bool:
    """Whether places (N, D) lie on a grid much wider than a step, as whole pixels do."""
    apart = (torch.unique((axis / step).round()).diff() for axis in places.unbind(-1))
    return any(len(each) > 0 and float(each.min()) > _COARSE for each in apart)


def _merged(straight: list[range], curved: list[range]) -> list[range]:
    """Lines, and curves that hold none."""
    starts = {line[0] for line in straight}
    return straight + [each for each in curved if starts.isdisjoint(each)]


def _lines(bend: list[float], place: Tensor, reach: int) -> list[range]:
    """Frames inside of the lines of a joint.

    Args:
        bend: differences about the frames from ``reach + 1`` on: second ones, or fourth ones, which
            are 0 on curves of the third degree.
        place: (F, D).
        reach: frames on either side of those about which differences are 0 that are on the line.
    """
    found, start = [], None
    for index, value in enumerate([*bend, torch.inf]):
        if value <= _OFF:
            start = index if start is None else start
            continue
        if start is not None and index - start >= _SHORTEST:
            ends = [bend[i] for i in (start - 1, index) if 0 <= i < len(bend)]
            moved = float((place[index + 1] - place[start]).norm())
            kinks = sum(
                each > _KINK for each in ends
            )  # of what is smooth everywhere, there is none
            if kinks > reach and not any(each <= _KINK for each in ends) and moved > _MOVED:
                found.append(range(start + 1, index + 1 + 2 * reach))
        start = None
    return found
