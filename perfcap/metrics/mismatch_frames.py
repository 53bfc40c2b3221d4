"""Truths of other frames: much later or earlier, in reversed order, or of another clip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.geometry.alignment import similarity_align
from perfcap.metrics.lags import in_words

_FARTHEST = 200  # frames
_AROUND = 10  # frames: a reversed truth may be so far aside; lags that are nearer are one
_LOOKED = 200  # frames whose poses are compared; the error is that of all
_ENOUGH, _POSES = 30, 0.03  # frames that show it, and m that the distances of the truth change
_STEADY, _JOINTS = 0.9, 8  # share of frames in which joints are known, and how many of them
# Of the same time poses change together, those of captures with large errors too. What they do not
# have in common must fall to this share of what it is now
_ALIKE, _APART = 0.6, 0.5
# The same of a reversed order, and the share of the error of its poses: fewer are mistaken so
_TURNED, _HALF = 0.8, 0.5
_RIVAL = 0.1  # of what is in common, by which other frames may be worse than the best
_LEFT, _POSED = 0.4, 0.7  # share of the error that is left, and of the error of aligned poses
_SURE = 0.6  # of the error of the nearest frames, that others must leave to be taken in their place


@dataclass(frozen=True)
class Recorded:
    """All that is known of a truth, of which a result may have a part.

    Attributes:
        joints: (T, J, 3), metres; NaN where unknown.
        frames: their numbers, (T,).
    """

    joints: Tensor
    frames: Tensor

    def valid(self) -> Tensor:
        """Joints that are known, (T, J)."""
        return self.joints.isfinite().all(-1)

    def rows(self, numbers: Tensor) -> Tensor:
        """Rows of frames with these numbers, (F,); -1 where there are none."""
        ordered, order = self.frames.sort()
        place = torch.searchsorted(ordered, numbers).clamp(max=len(ordered) - 1)
        return torch.where(ordered[place] == numbers, order[place], -1)


def error(estimate: Tensor, truth: Tensor, valid: Tensor) -> float:
    """Mean distance of joints (F, J, 3) that count, (F, J), m."""
    return float((estimate - truth)[valid].norm(dim=-1).mean())


def aligned_error(estimate: Tensor, truth: Tensor, valid: Tensor) -> float:
    """The same after a similarity of each frame, m."""
    return error(similarity_align(estimate, truth, valid.to(estimate.dtype)), truth, valid)


def in_common(estimate: Tensor, truth: Tensor, valid: Tensor) -> float:
    """Correlation over time of the distances of joints from each other, in any worlds.

    1 where too few joints are known in nearly all frames, or the truth hardly changes its pose.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
    """
    steady = _steady(valid)
    always = valid[:, steady].all(-1)
    if int(steady.sum()) < _JOINTS or int(always.sum()) < _ENOUGH:
        return 1.0
    true = _distances(truth[always][:, steady])
    if not _changes(true) > _POSES:
        return 1.0
    return _correlation(_distances(estimate[always][:, steady]), true)


def other_frames(
    estimate: Tensor, truth: Tensor, valid: Tensor, numbers: Tensor, whole: Recorded, near: int
) -> Iterator[str]:
    """That a truth fits with frames far from those with the same numbers, or in reversed order.

    Poses must change as those of the result then do, and not as they are now: places alone are
    nearer with other frames of whoever walks on, too, where a result is off by a metre or drifts.
    Where a motion repeats itself several lags may fit; places decide, or else the smallest.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: those with the same numbers, the same.
        valid: joints that count, (F, J).
        numbers: of the frames, (F,).
        whole: the truth that has others too.
        near: frames up to which a lag is looked for elsewhere.
    """
    looked = _looked(estimate, valid, numbers, whole)
    if looked is None:
        return
    now = looked.alike(numbers[looked.frames])
    later = _later(looked, now)
    least = 0.0 if later is None else later.alike + _RIVAL
    turned = [fit for fit in _reversed(looked, now) if fit is not None and fit.alike > least]
    fit = max(turned, key=lambda each: each.alike, default=later)
    if fit is not None and (turned or abs(fit.lag) > near):
        yield from _told(fit, estimate, truth, valid, numbers, whole, near)


@dataclass(frozen=True)
class _Fit:
    """Other frames whose poses are those of the result, and some that are nearly as alike.

    Attributes:
        lag: of the numbers that fit.
        others: lags that may fit as well.
        turned: the sum of the numbers of a frame and of its truth, where their order is reversed.
        alike: what the poses have in common.
    """

    lag: int
    others: tuple[int, ...]
    alike: float
    turned: int | None = None

    def numbers(self, numbers: Tensor, lag: int) -> Tensor:
        """Those of the truth that some of the result have with a lag, (F,)."""
        return numbers + lag if self.turned is None else self.turned - numbers + lag


@dataclass(frozen=True)
class _Looked:
    """Distances of joints of the frames that are compared, and of all of a truth.

    Attributes:
        frames: rows of the result, (N,).
        numbers: of its frames, (F,).
        own: distances in these rows, (N, P), m.
        true: in all of the truth, (T, P), m; NaN where a joint is unknown.
        known: frames of it that have all, (T,).
        whole: the truth.
    """

    frames: Tensor
    numbers: Tensor
    own: Tensor
    true: Tensor
    known: Tensor
    whole: Recorded

    def alike(self, numbers: Tensor) -> float:
        """What poses have in common with those of some numbers, (N,); NaN where too few do."""
        rows = self.whole.rows(numbers)
        both = (rows >= 0) & self.known[rows]
        share = 2 * int(both.sum()) >= len(rows)
        count = int(both.sum()) * len(self.numbers) // max(len(rows), 1)
        if not share or count < _ENOUGH:
            return float("nan")
        own, true = self.own[both], self.true[rows[both]]
        # a stretch in which one of them rests is like any other
        if not min(_changes(own), _changes(true)) > _POSES:
            return float("nan")
        return _correlation(own, true)


def _looked(estimate: Tensor, valid: Tensor, numbers: Tensor, whole: Recorded) -> _Looked | None:
    """None where too little is known."""
    steady = _steady(valid)
    rows = valid[:, steady].all(-1).nonzero()[:, 0]
    if int(steady.sum()) < _JOINTS or len(rows) < _ENOUGH:
        return None
    rows = rows[:: -(-len(rows) // _LOOKED)]
    own, true = (_distances(points[:, steady]) for points in (estimate[rows], whole.joints))
    return _Looked(rows, numbers, own, true, true.isfinite().all(-1), whole)


def _later(looked: _Looked, now: float) -> _Fit | None:
    return _best(looked, now, None, range(-_FARTHEST, _FARTHEST + 1))


def _reversed(looked: _Looked, now: float) -> Iterator[_Fit | None]:
    """The truth as a whole in reversed order, or its part that a result shows."""
    known = looked.whole.frames
    ends = {int(part.min() + part.max()) for part in (known, looked.numbers)}
    for turned in sorted(ends):
        yield _best(looked, now, turned, range(-_AROUND, _AROUND + 1))


def _best(looked: _Looked, now: float, turned: int | None, lags: Sequence[int]) -> _Fit | None:
    """The lag with most in common, and those that are no worse than it by much."""
    some = looked.numbers[looked.frames]
    empty = _Fit(0, (), 0.0, turned)
    alike = {lag: looked.alike(empty.numbers(some, lag)) for lag in lags}
    alike = {lag: value for lag, value in alike.items() if value == value}
    if not alike:
        return None
    lag = max(alike, key=lambda each: alike[each])
    least = max(_ALIKE if turned is None else _TURNED, 1 - _APART * (1 - now))
    if alike[lag] < least:
        return None
    peaks: list[int] = []
    for each in sorted(alike, key=lambda one: -alike[one]):
        apart = all(abs(each - other) > _AROUND for other in peaks)
        if apart and alike[each] >= max(alike[lag] - _RIVAL, least):
            top = max(alike.get(each - 1, -1.0), alike.get(each + 1, -1.0))
            peaks += [each] if alike[each] >= top else []
    return _Fit(lag, tuple(peaks), alike[lag], turned)


def _told(
    fit: _Fit,
    estimate: Tensor,
    truth: Tensor,
    valid: Tensor,
    numbers: Tensor,
    whole: Recorded,
    near: int,
) -> Iterator[str]:
    known = whole.valid()
    shares = {}
    for lag in {*fit.others, fit.lag}:
        rows = whole.rows(fit.numbers(numbers, lag))
        both = (rows >= 0)[:, None] & known[rows] & valid
        some = both.any(-1)
        here, now, there, both = estimate[some], truth[some], whole.joints[rows[some]], both[some]
        placed = error(here, there, both) / max(error(here, now, both), 1e-9)
        posed = aligned_error(here, there, both) / max(aligned_error(here, now, both), 1e-9)
        shares[lag] = placed, posed
    nearest = min(shares, key=lambda lag: shares[lag][0])
    alike = [lag for lag in shares if shares[lag][1] <= shares[fit.lag][1] + _RIVAL]
    lag = min(alike, key=abs)
    if shares[nearest][0] < _SURE * shares[lag][0]:
        lag = nearest
    left, pose = shares[lag]
    told = abs(lag) > near and pose < _POSED if fit.turned is None else pose < _HALF
    if not told:
        return
    words = f"{left:.0%} of the error is left"
    if left >= _LEFT:
        words = f"{pose:.0%} of the error is left, aligned frame by frame"
    if fit.turned is not None:
        yield f"with the truth in reversed order {words}; give its frames in the order of the video"
        return
    yield (
        f"with the truth of {in_words(lag)} {words}; check the numbers of its frames (a clip that "
        "was cut counts from 0)"
    )


def _steady(valid: Tensor) -> Tensor:
    """Joints that are known in nearly all frames that have any, (J,): no data set has all."""
    rows = valid.any(-1)
    return valid[rows].double().mean(0) >= _STEADY


def _distances(points: Tensor) -> Tensor:
    """Of all joints from each other, (F, P), m."""
    first, second = torch.triu_indices(points.shape[1], points.shape[1], 1, device=points.device)
    apart: Tensor = (points[:, first] - points[:, second]).norm(dim=-1)
    return apart


def _changes(distances: Tensor) -> float:
    """By how much they change over time, root mean square, m."""
    return float((distances - distances.mean(0)).square().mean().sqrt())


def _correlation(own: Tensor, true: Tensor) -> float:
    own, true = own - own.mean(0), true - true.mean(0)
    return float((own * true).sum() / (own.norm() * true.norm()).clamp(min=1e-9))
