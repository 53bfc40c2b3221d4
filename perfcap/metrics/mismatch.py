"""Mistakes that explain why an estimate is far from its truth: other worlds, frames and sides."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import torch
from torch import Tensor

from perfcap.metrics.lags import in_words, overlap
from perfcap.metrics.mismatch_frames import (
    Recorded,
    aligned_error,
    error,
    in_common,
    other_frames,
)
from perfcap.metrics.mismatch_named import Numbered
from perfcap.metrics.mismatch_parts import explained_in_parts, sizes_in_parts
from perfcap.metrics.mismatch_repeats import never_measured, repeats, said_of_zeros
from perfcap.metrics.mismatch_root import root_mismatches
from perfcap.metrics.mismatch_world import (
    Compared,
    World,
    moved_world,
    relative_world,
    turned,
)

_FAR = 0.05  # m: a nearer estimate needs no explanation
_LEFT = 0.4  # share of the error that an explanation may leave
_POSED = 0.5  # the same of the pose alone, where worlds differ: the depth of one view is its least
_LAGS = 10  # frames
# Share of the error of the pose alone that a few frames may leave: right results, poor ones
# included, keep 0.98 of it, those with a truth one frame late 0.33 to 0.6, where joints are near
_LATE = 0.7
_RATES = (2.0, 0.5, 4.0, 0.25, 1.2, 1 / 1.2, 2.4, 1 / 2.4)  # among 25, 30, 50, 60, 120 a second
_FEWEST = 10  # frames that tell a rate
_NOTHING = 0.05  # share of the error, of a rate that leaves the poses as they are
_STILL = 1e-3  # m
_LARGER = 1.8  # than a person: a child captured as an average adult is not that far off
# Of distances of joints over time: of right results 0.76 and more, poor ones included, of two clips
# of recorded people 0.15 in nine of ten pairs
_COMMON = 0.2
_STRANGE = 0.15  # m, after a similarity of each frame: joints of another order


def mismatches(
    estimate: Tensor,
    truth: Tensor,
    valid: Tensor,
    mirrored: Sequence[int],
    *,
    frames: Sequence[int] = (),
    joints: Sequence[str] = (),
    whole: Tensor | None = None,
    whole_frames: Sequence[int] = (),
) -> tuple[str, ...]:
    """A sentence for each mistake in the truth, or in what it is compared with, that shows.

    Each must take most of the error away by itself, in all frames or in a stretch of them; errors
    of captures do not look like that.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
        mirrored: each joint's counterpart on the other side; itself in the middle.
        frames: their numbers, (F,); counted from 0 where none are given.
        joints: their names, (J,).
        whole: joints (T, J, 3) of all frames of the truth, metres, NaN where unknown; those of
            ``truth`` where none are given.
        whole_frames: their numbers, (T,).
    """
    if not bool(valid.any()):
        return ()
    named = Numbered(frames, joints)
    numbers = torch.as_tensor(list(frames or range(len(truth))), device=truth.device)
    known = torch.where(valid[..., None], truth, torch.nan)
    recorded = Recorded(known, numbers)
    if whole is not None:
        recorded = Recorded(whole, torch.as_tensor(list(whole_frames), device=truth.device))
    zeros = list(never_measured(estimate, truth, valid))
    measured = valid.clone()
    measured[:, zeros] = False
    compared = Compared(estimate, truth, measured, recorded)
    return (
        *repeats(estimate, truth, measured, named),
        *said_of_zeros(zeros, named),
        *_mistakes(compared, mirrored, named, numbers),
    )


def _mistakes(
    compared: Compared,
    mirrored: Sequence[int],
    named: Numbered,
    numbers: Tensor,
    looked: tuple[World, ...] = (),
) -> tuple[str, ...]:
    """Those that take most of the error away, or leave poses that have nothing in common.

    Where another world is all that is found, it is taken away, and what is left is looked at as if
    it had always been of one world.

    Args:
        compared: what is left.
        mirrored: each joint's counterpart.
        named: what frames and joints are called.
        numbers: of the frames, (F,).
        looked: other worlds that were found, and taken away.
    """
    estimate, truth, valid = compared.estimate, compared.truth, compared.valid
    if not bool(valid.any()):
        return ()
    far = error(estimate, truth, valid) >= _FAR
    step = _step(named.frames)
    found: tuple[str | World, ...] = tuple(sizes_in_parts(estimate, truth, valid, named))
    if not found:  # a frame or two are most of the error of a good capture, and less than far
        worlds = not looked or looked[-1].relative
        found = tuple(
            _explained(compared, mirrored, step, numbers, worlds)
            if far
            else _late(estimate, truth, valid, step)
        )
    others = [each for each in found if isinstance(each, World)]
    told = tuple(each.note if isinstance(each, World) else each for each in found)
    if others and len(others) == len(found):
        for world in others:
            compared = world.without(compared)
        return (*told, *_mistakes(compared, mirrored, named, numbers, (*looked, *others)))
    if far and not told:
        told = tuple(root_mismatches(estimate, truth, valid))
    told = told or tuple(explained_in_parts(estimate, truth, valid, mirrored, named))
    if told or not far:
        return told
    left = aligned_error(estimate, truth, valid)
    if left > _STRANGE:
        return (
            f"even aligned frame by frame the joints are {1000 * left:.0f} mm off; check that "
            "those of the truth are in the order of the landmarks, and of this person and clip",
        )
    if in_common(estimate, truth, valid) < _COMMON:
        return (
            "the poses of the result and of the truth change independently of each other; check "
            "that the truth is of this clip and person",
        )
    return ()


def _step(frames: Sequence[int]) -> int:
    """By how much the numbers of frames grow from row to row, mostly."""
    steps = sorted(after - before for before, after in pairwise(frames))
    return max(steps[len(steps) // 2], 1) if steps else 1


def _explained(
    compared: Compared, mirrored: Sequence[int], step: int, numbers: Tensor, worlds: bool
) -> Iterator[str | World]:
    """What takes most of the error away in all frames; of other worlds only if asked for."""
    estimate, truth, valid = compared.estimate, compared.truth, compared.valid
    now = error(estimate, truth, valid)
    larger = _size(truth, valid) / max(_size(estimate, valid), _STILL)
    if not 1 / _LARGER < larger < _LARGER:
        yield (
            f"the person of the truth is {larger:.2f} times as large as that of the result; "
            "expected metres (those in feet are 3.28 times as many)"
        )
    relative = list(relative_world(compared)) if worlds else []
    yield from relative
    rate, left = _best_rate(estimate, truth, valid)
    if left >= min(_LEFT, _best_lag(estimate, truth, valid, error)[1]):
        elsewhere = list(
            other_frames(estimate, truth, valid, numbers, compared.whole, step * _LAGS)
        )
        if elsewhere:  # what the same frames would have in other worlds shows once these are right
            yield from elsewhere
            return
        yield from _late(estimate, truth, valid, step)
    else:
        yield (
            f"with a truth of {rate:.3g} times the frame rate {left:.0%} of the error is left; "
            "give the truth of every frame of the result, in its rate"
        )
    order = list(mirrored)
    left = error(estimate[:, order], truth, valid) / now
    if left < _LEFT:
        yield (
            f"with left and right of the truth exchanged {left:.0%} of the error is left; left and "
            "right are the person's own"
        )
    elif (pose := aligned_error(estimate, truth, valid)) > _FAR:
        left = aligned_error(estimate[:, order], truth, valid) / pose
        if left < _POSED:
            yield (
                f"with left and right of the truth exchanged {left:.0%} of the error is left, "
                "aligned frame by frame; left and right are the person's own"
            )
    if worlds and not relative:  # axes are compared once both are relative
        yield from moved_world(compared)
    _, left = turned(estimate, truth, valid)
    _, image = turned(estimate * estimate.new_tensor([-1.0, 1.0, 1.0]), truth, valid)
    if image < _LEFT * min(left, now):
        yield (
            f"in a mirror {image / now:.0%} of the error is left; one axis of the truth runs the "
            "other way, expected none or two"
        )


def _size(points: Tensor, valid: Tensor) -> float:
    """Median distance of joints from the middle of those of their frame, m."""
    known = torch.where(valid[..., None], points, torch.nan)
    apart = (known - known.nanmean(-2, keepdim=True)).norm(dim=-1)
    return float(apart[valid].median())


def _late(estimate: Tensor, truth: Tensor, valid: Tensor, step: int) -> Iterator[str]:
    """A truth of frames a little later or earlier, by places or, in any world, by poses."""
    lag, left = _best_lag(estimate, truth, valid, error)
    aligned = ""
    if left >= _LEFT:
        lag, left = _best_lag(estimate, truth, valid, aligned_error)
        aligned = ", aligned frame by frame"
    if left < (_LATE if aligned else _LEFT):
        yield (
            f"with the truth of {in_words(step * lag)} {left:.0%} of the error is left{aligned}; "
            "check the numbers of its frames"
        )


def _best_lag(
    estimate: Tensor, truth: Tensor, valid: Tensor, error: Callable[[Tensor, Tensor, Tensor], float]
) -> tuple[int, float]:
    """By how many frames the truth fits best, and the share of the error that this leaves."""
    best = 0, 1.0
    for lag in range(-_LAGS, _LAGS + 1):
        if lag == 0 or abs(lag) >= len(truth) // 2:
            continue
        here, there = overlap(len(truth), lag)
        both = valid[here] & valid[there]
        if not bool(both.any()):
            continue
        before = error(estimate[here], truth[here], both)
        left = error(estimate[here], truth[there], both) / max(before, 1e-9)
        best = min(best, (lag, left), key=lambda each: each[1])
    return best


def _best_rate(estimate: Tensor, truth: Tensor, valid: Tensor) -> tuple[float, float]:
    """In how many times the frame rate the truth fits best, and the share that this leaves.

    Both begin with the same frame, and are not resampled: frames are the nearest ones. Poses must
    fit better, too, or hardly any error be left: a truth that drifts away drifts less in a few of
    its frames than in all.
    """
    best = 1.0, 1.0
    for rate in _RATES:
        here = torch.arange(len(truth), device=truth.device)
        there = (here * rate).round().long()
        here, there = here[there < len(truth)], there[there < len(truth)]
        both = valid[here] & valid[there]
        if len(here) < _FEWEST or not bool(both.any()):
            continue
        found, now, then = estimate[here], truth[here], truth[there]
        left = error(found, then, both) / max(error(found, now, both), 1e-9)
        if left >= best[1]:
            continue
        pose = aligned_error(found, then, both) / max(aligned_error(found, now, both), 1e-9)
        if left < _NOTHING or pose < _LATE:
            best = rate, left
    return best
