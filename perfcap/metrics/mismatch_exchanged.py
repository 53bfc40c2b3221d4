"""Stretches of a truth in which left and right joints have each other's places."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from perfcap.metrics.mismatch_named import Numbered, runs

_FAR = 0.05  # m: nearer joints of an estimate need no explanation
# Share of the error that one pair leaves the other way, and the others that go with it. The mean of
# all joints says nothing of one pair of wrists, so that each pair is judged by its own error.
_LEFT, _WITH = 0.6, 0.8
_USUAL = 3.0  # times the error of other frames that all joints may keep
_POOR = 0.15  # m that they may keep in any case: captures begin, and turn, that far off
_STEP = 0.06  # m that both joints of a pair go from one frame to the next
_NEARER = 0.5  # share of that way if one takes the place of the other
_GAP, _SHORTEST = 6, 5  # frames


@dataclass(frozen=True)
class _Pair:
    """A left and a right joint: how far off they are, and what the truth shows of them alone."""

    joints: tuple[int, int]
    now: Tensor  # mean error of both in each frame, (F,) m; NaN where one of them is unknown
    other: Tensor  # the same where they are exchanged
    ways: dict[int, tuple[float, float]]  # to each frame: how far they go, and if exchanged, m

    def changes(self, frame: int) -> bool:
        """Whether both take each other's places in this frame."""
        way, other = self.ways.get(frame, (0.0, 0.0))
        return way > _STEP and other < _NEARER * way

    def may_change(self, frame: int) -> bool:
        """Whether that is not contradicted, as where both are near each other."""
        way, other = self.ways.get(frame, (0.0, 0.0))
        return other <= way

    def left(self, first: int, last: int) -> float:
        """The share of the error that is left the other way; NaN where they are unknown."""
        part = slice(first, last + 1)
        return float(self.other[part].nanmean() / self.now[part].nanmean())


def exchanged_in_parts(
    estimate: Tensor, truth: Tensor, valid: Tensor, mirrored: Sequence[int], named: Numbered
) -> Iterator[tuple[int, int, str]]:
    """Stretches with left and right exchanged in some pairs of joints: rows, and a sentence.

    The truth itself must show where it begins and ends: both joints of a pair take each other's
    places from one frame to the next. A result that has exchanged them shows no such thing there.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
        mirrored: each joint's counterpart on the other side; itself in the middle.
        named: what frames and joints are called.

    Yields:
        First row, last row, and what is said of them.
    """
    pairs = [
        _pair(estimate, truth, valid, (one, other))
        for one, other in enumerate(mirrored)
        if one < other
    ]
    count = len(truth)
    edges = sorted({frame for pair in pairs for frame in pair.ways if pair.changes(frame)})
    stretches: dict[tuple[int, int], list[_Pair]] = {}
    for pair in pairs:
        wrong = torch.zeros(count, dtype=torch.bool)
        for start, stop in pairwise([0, *edges, count]):
            wrong[start:stop] = pair.left(start, stop - 1) < 1  # limbs may cross within a stretch
        for first, last in runs(wrong, hole=0):
            ends = [frame for frame in (first, last + 1) if 0 < frame < count]
            if ends and all(pair.may_change(frame) for frame in ends):
                stretches.setdefault((first, last), []).append(pair)
    for (first, last), each in sorted(stretches.items(), key=lambda item: item[0]):
        ends = [frame for frame in (first, last + 1) if 0 < frame < count]
        sure = any(
            all(pair.changes(frame) for frame in ends)
            and float(pair.now[first : last + 1].nanmean()) > _FAR
            and pair.left(first, last) < _LEFT
            for pair in each
        )
        if sure and last - first + 1 >= _SHORTEST:
            concerned = [pair for pair in each if pair.left(first, last) < _WITH]
            if not _explains(estimate, truth, valid, concerned, slice(first, last + 1)):
                continue
            yield first, last, _sentence(concerned, len(pairs), first, last, named)


def _pair(estimate: Tensor, truth: Tensor, valid: Tensor, joints: tuple[int, int]) -> _Pair:
    own, true, known = estimate[:, joints], truth[:, joints], valid[:, joints].all(-1)
    now, other = (
        torch.where(known, (own - there).norm(dim=-1).mean(-1), torch.nan)
        for there in (true, true.flip(1))
    )
    ways = {}
    for before, after in pairwise(known.nonzero()[:, 0].tolist()):
        if after - before <= _GAP:
            step = true[after] - torch.stack((true[before], true[before].flip(0)))
            straight, crossed = step.norm(dim=-1).mean(-1).tolist()
            ways[after] = straight, crossed
    return _Pair(joints, now.cpu(), other.cpu(), ways)


def _explains(
    estimate: Tensor, truth: Tensor, valid: Tensor, pairs: Sequence[_Pair], part: slice
) -> bool:
    """Whether all joints are then as near as in other frames, or so.

    Parts of a truth that are mirrored or of another person are nearer the other way, too.
    """
    order = list(range(truth.shape[1]))
    for one, other in (pair.joints for pair in pairs):
        order[one], order[other] = other, one
    now, left = (
        torch.where(there[1], (estimate - there[0]).norm(dim=-1), torch.nan).nanmean(-1)
        for there in ((truth, valid), (truth[:, order], valid & valid[:, order]))
    )
    outside = torch.cat((now[: part.start], now[part.stop :])).nanmedian()
    return float(left[part].nanmean()) < max(_POOR, _USUAL * float(outside))


def _sentence(pairs: Sequence[_Pair], count: int, first: int, last: int, named: Numbered) -> str:
    part = slice(first, last + 1)
    now, left = (
        float(torch.stack([each[part] for each in errors]).nanmean())
        for errors in ([pair.now for pair in pairs], [pair.other for pair in pairs])
    )
    which = ""
    if len(pairs) < count:
        *some, final = [_without_side(named, pair.joints) for pair in pairs]
        which = f" {', '.join(some)} and {final}" if some else f" {final}"
    whose = "the error" if len(pairs) == count else "their error"
    return (
        f"in {named.stretch(first, last)} with left and right{which} of the truth exchanged "
        f"{left / now:.0%} of {whose} is left, and not in the others; left and right are the "
        "person's own, in all frames"
    )


def _without_side(named: Numbered, joints: tuple[int, int]) -> str:
    """What both are called: knee for r_knee and l_knee."""
    one, other = (named.joint(joint) for joint in joints)
    if one[2:] == other[2:] and {one[:2], other[:2]} == {"l_", "r_"}:
        return one[2:]
    return f"{one} / {other}"
