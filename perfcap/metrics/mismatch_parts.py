"""Mistakes in a truth that begin or end within the clip, and joints of it that are exchanged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from perfcap.geometry.alignment import procrustes
from perfcap.geometry.rotation import matrix_to_rotvec
from perfcap.metrics.mismatch_exchanged import exchanged_in_parts
from perfcap.metrics.mismatch_named import Numbered, runs

_PART = 10  # frames of a part; parts overlap by half
_FAR = 0.05  # m: a nearer estimate needs no explanation
_RAISED = 2.0  # times the usual error of the clip
_LEFT, _BETTER = 0.4, 0.6  # share of the error that is left in a part, and in a frame of it
_LAGS = 10  # frames
_TURN = 10.0  # degrees
_STEP, _USUAL = 0.08, 4.0  # m from one frame to the next, and times what is usual
_STILL, _SHORTEST = 1e-4, 5  # m, and frames of a pose that is held
_LARGER = 1.8
_HELD = 0.75  # share of the frames of a stretch that a cause must explain
_SUDDEN = 2.0  # times the steps of the truth beside it, and that of the result
_LEAP = 1.5  # times the error beside a stretch
_SIMPLER, _NOTHING = 1.2, 0.005  # times the least error that is left, and m
_NUMBERS = "check the numbers of its frames from there on"


def sizes_in_parts(
    estimate: Tensor, truth: Tensor, valid: Tensor, named: Numbered
) -> Iterator[str]:
    """Frames in which the truth is of another unit than in the others.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
        named: what frames and joints are called.
    """
    ratio = _sizes(truth, valid) / _sizes(estimate, valid)
    known = ratio.isfinite()
    wrong = known & ((ratio > _LARGER) | (ratio < 1 / _LARGER))
    share = float(wrong[known].double().mean()) if bool(known.any()) else 0.0
    if not 0 < share < 1:
        return
    for first, last in runs(wrong):
        if last - first + 1 >= _SHORTEST:
            yield (
                f"in {named.stretch(first, last)} the person of the truth is "
                f"{float(ratio[first : last + 1].nanmedian()):,.1f} times as large as that of the "
                "result, and not in the others; expected metres in all"
            )


def explained_in_parts(
    estimate: Tensor, truth: Tensor, valid: Tensor, mirrored: Sequence[int], named: Numbered
) -> Iterator[str]:
    """Mistakes of some frames of a truth, and joints of it that are exchanged in all of them.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
        mirrored: each joint's counterpart on the other side; itself in the middle.
        named: what frames and joints are called.
    """
    held = list(_held(estimate, truth, valid, named))
    yield from held
    sides = list(exchanged_in_parts(estimate, truth, valid, mirrored, named))
    yield from (sentence for *_, sentence in sides)
    if not held:
        told = torch.zeros(len(truth), dtype=torch.bool)
        for first, last, _ in sides:
            told[first : last + 1] = True
        yield from _other_frames(estimate, truth, valid, told, named)
    if not sides:  # of a stretch of half of the clip and more it would say that it is all frames
        yield from _exchanged(estimate, truth, valid, named)


def _errors(estimate: Tensor, truth: Tensor, valid: Tensor) -> Tensor:
    """Mean error of each frame, (F,), m; NaN where no joint counts."""
    return torch.where(valid, (estimate - truth).norm(dim=-1), torch.nan).nanmean(-1)


def _sizes(points: Tensor, valid: Tensor) -> Tensor:
    """Median distance of joints from their middle in each frame, (F,), m."""
    known = torch.where(valid[..., None], points, torch.nan)
    apart: Tensor = (known - known.nanmean(-2, keepdim=True)).norm(dim=-1)
    return apart.nanmedian(-1).values


def _steps(points: Tensor, valid: Tensor) -> Tensor:
    """How far joints go from the frame before, median of each frame, (F,), m; none in the first."""
    both = valid[1:] & valid[:-1]
    steps = torch.where(both, points.diff(dim=0).norm(dim=-1), torch.nan).nanmedian(-1).values
    return torch.cat((steps.new_zeros(1), steps.nan_to_num(0.0)))


def _held(estimate: Tensor, truth: Tensor, valid: Tensor, named: Numbered) -> Iterator[str]:
    """Poses that a truth repeats to the last digit while the result moves on."""
    moved = (truth.diff(dim=0).norm(dim=-1) > _STILL) & valid[1:] & valid[:-1]
    still = torch.cat((moved.new_zeros(1), ~moved.any(-1) & valid[1:].any(-1)))
    for first, last in runs(still, hole=0):
        part = slice(first - 1, last + 1)
        both = valid[part].all(0)
        way = (estimate[part] - estimate[first - 1])[:, both].norm(dim=-1)
        if last - first + 2 >= _SHORTEST and bool(both.any()) and float(way.mean(-1).max()) > _FAR:
            yield (
                f"the truth stands still in {named.stretch(first - 1, last)}, to a tenth of a "
                "millimetre, and the result moves; were gaps filled with the last pose? Leave such "
                "frames out (--frames), or give what was measured there"
            )


@dataclass(frozen=True)
class _Explanation:
    """What would be so, and the errors of all frames if it were, (F,) m; how it is told."""

    errors: Tensor
    words: str
    remedy: str
    lag: int = 0

    def holds(self, now: Tensor, run: tuple[int, int], far: float) -> bool:
        """Whether it explains all of a stretch: no cause of its ends alone, and none by half.

        A lag is judged by those frames whose other frame is in the stretch, too: where the truth
        is wrong in any way, a lag reaches right frames beyond its ends.
        """
        first, last = run
        inside = slice(max(first, first - self.lag), min(last, last - self.lag) + 1)
        errors, before = self.errors[inside], now[inside]
        known = errors.isfinite() & before.isfinite()
        if int(known.sum()) < _SHORTEST:
            return False
        better = (errors < _BETTER * before)[known].double().mean()
        return float(better) >= _HELD and float(errors[known].median()) < far


def _other_frames(
    estimate: Tensor, truth: Tensor, valid: Tensor, told: Tensor, named: Numbered
) -> Iterator[str]:
    """Stretches of frames that are far off, and why; not those that are told, (F,)."""
    now = _errors(estimate, truth, valid)
    far, count = max(_FAR, _RAISED * float(now.nanmedian())), len(now)
    steps = _steps(truth, valid)
    leaps = steps > max(_STEP, _USUAL * float(steps.median()))
    starts = [*range(0, count - _PART, _PART // 2), count - _PART] if count > _PART else []
    wrong, found = runs(now > far), []
    for part in (slice(start, start + _PART) for start in starts):
        here = float(now[part].nanmedian())
        if here > far:
            run = _most(wrong, part)
            causes = [
                one
                for one in _explanations(estimate, truth, valid, part)
                if one.holds(now, run, far)
            ]
            if causes:
                best, left = _simplest(causes, part)
                found.append((left / here, _around(best.errors < _BETTER * now, part), best))
    for left, (first, last), best in sorted(found, key=lambda each: each[0]):
        edges = [edge for edge in (first, last + 1) if 0 < edge < count]
        sudden = any(bool(leaps[max(0, edge - 1) : edge + 2].any()) for edge in edges)
        # a capture errs by a motion for a while, too, but then no truth leaps
        sure = sudden or best.remedy == _NUMBERS
        free = not bool(told[first : last + 1].any()) and last - first + 1 >= _SHORTEST
        if left < _LEFT and sure and free:
            told[first : last + 1] = True
            yield (
                f"in {named.stretch(first, last)} {best.words} {left:.0%} of the error is left, "
                f"and not in the others; {best.remedy}"
            )
    yield from _without_cause(estimate, truth, valid, told, named)


def _without_cause(
    estimate: Tensor, truth: Tensor, valid: Tensor, told: Tensor, named: Numbered
) -> Iterator[str]:
    """Stretches that are far off, at whose ends the truth leaps and the result does not."""
    now, count = _errors(estimate, truth, valid), len(truth)
    true, own = _steps(truth, valid), _steps(estimate, valid)
    least = max(_STEP, _USUAL * float(true.median()))
    edges = []
    for frame in (true > least).nonzero()[:, 0].tolist():
        beside = torch.cat((true[max(0, frame - 2) : frame], true[frame + 1 : frame + 3]))
        known = bool(told[frame] == told[frame - 1])  # not the end of what is told
        if known and float(true[frame]) > _SUDDEN * max(float(beside.max()), float(own[frame])):
            edges.append(frame)
    for start, stop in pairwise([0, *edges, count]):
        others = torch.ones(count, dtype=torch.bool)
        others[start:stop] = False
        here, there = float(now[start:stop].nanmedian()), float(now[others].nanmedian())
        free = not bool(told[start:stop].any()) and _PART <= stop - start <= count // 2
        ends = [  # errors of three frames inside, and of three outside
            (now[start : start + 3], now[max(0, start - 3) : start]),
            (now[stop - 3 : stop], now[stop : stop + 3]),
        ]
        leap = all(
            float(inside.nanmedian()) > _LEAP * float(outside.nanmedian())
            for inside, outside in ends
            if len(outside)
        )
        if free and leap and here > max(_FAR, _RAISED * there):
            yield (
                f"{named.stretch(start, stop - 1)} are far off ({1000 * here:.0f} mm, "
                f"{1000 * there:.0f} mm elsewhere), and the truth leaps there from one frame to "
                "the next while the result does not; check where these frames of it come from"
            )


def _simplest(found: Sequence[_Explanation], part: slice) -> tuple[_Explanation, float]:
    """The first of those that leave hardly more than the least in a part, and the rest, m."""
    each = [(one, float(one.errors[part].nanmedian())) for one in found]
    least = min(left for _, left in each)
    return next((one, left) for one, left in each if left <= _SIMPLER * least + _NOTHING)


def _explanations(
    estimate: Tensor, truth: Tensor, valid: Tensor, part: slice
) -> Iterator[_Explanation]:
    yield from _best_lag(estimate, truth, valid, part)
    counts = valid[part]
    if int(counts.sum()) < 4:
        return
    source, target = estimate[part][counts], truth[part][counts]
    move = (target - source).median(0).values
    yield _Explanation(
        _errors(estimate + move, truth, valid),
        f"after one shift of {float(move.norm()):.2f} m",
        "the truth jumps there; give all of it in one place",
    )
    turned = procrustes(source, target, scale=False)
    angle = float(matrix_to_rotvec(turned.rotation).norm().rad2deg())
    if angle > _TURN:
        yield _Explanation(
            _errors(turned.apply(estimate), truth, valid),
            f"after one rotation by {angle:.0f} degrees",
            "give all of the truth in the world of the cameras",
        )


def _best_lag(
    estimate: Tensor, truth: Tensor, valid: Tensor, part: slice
) -> Iterator[_Explanation]:
    """The lag of the truth that leaves least in a part."""
    best, least = None, float("inf")
    for lag in range(-_LAGS, _LAGS + 1):
        rows = torch.arange(len(truth), device=truth.device) + lag
        inside = (rows >= 0) & (rows < len(truth))
        rows = rows.clamp(0, len(truth) - 1)
        errors = _errors(estimate, truth[rows], valid[rows] & inside[:, None])
        left = float(errors[part].nanmedian())
        if lag and left < least:
            words = f"with the truth of {abs(lag)} frames {'later' if lag > 0 else 'earlier'}"
            best, least = _Explanation(errors, words, _NUMBERS, lag), left
    if best is not None:
        yield best


def _exchanged(estimate: Tensor, truth: Tensor, valid: Tensor, named: Numbered) -> Iterator[str]:
    """Joints of the truth that are called by each other's names in all frames."""
    apart = torch.where(
        valid[:, None] & valid[:, :, None],
        (estimate[:, :, None] - truth[:, None]).norm(dim=-1),
        torch.nan,
    ).nanmedian(0).values  # estimated, true  # fmt: skip
    known = valid.any(0).nonzero()[:, 0]
    cost = apart[known][:, known]
    if not len(known) or not bool(cost.isfinite().all()):
        return
    rows, columns = linear_sum_assignment(cost.cpu().numpy())
    moved = [
        (int(known[row]), int(known[column]))
        for row, column in zip(rows, columns, strict=True)
        if row != column
    ]
    if not moved:
        return
    now = sum(float(apart[joint, joint]) for joint, _ in moved) / len(moved)
    left = sum(float(apart[joint, other]) for joint, other in moved) / len(moved)
    if now > _FAR and left < _LEFT * now:
        some = ", ".join(f"{named.joint(b)} looks like {named.joint(a)}" for a, b in moved[:4])
        more = f" and {len(moved) - 4} more" if len(moved) > 4 else ""
        yield (
            f"joints of the truth look exchanged ({some}{more}): {left / now:.0%} of their error "
            "is left the other way; give them in the order of the landmarks"
        )


def _around(wrong: Tensor, part: slice) -> tuple[int, int]:
    """The stretch of wrong frames that has most of a part."""
    return _most(runs(wrong) or [(part.start, part.stop - 1)], part)


def _most(found: Sequence[tuple[int, int]], part: slice) -> tuple[int, int]:
    """The stretch that has most of a part."""
    return max(found, key=lambda run: min(run[1] + 1, part.stop) - max(run[0], part.start))
