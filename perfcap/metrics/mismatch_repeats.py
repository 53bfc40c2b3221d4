"""Poses of a truth that repeat the one before, and joints of it that stay at one place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from perfcap.metrics.mismatch_named import Numbered

_STILL = 1e-4  # m
_REPEATED, _CHANGES = 1 / 3, 1 / 6  # of the frames: repeated ones, and those that end a repetition
_FEWEST = 12  # frames
# Frames in which a joint has one place, and m that the result's goes there: a foot that stands on
# one place in the truth is not that far off
_ONE_PLACE, _GOES = 5, 0.1

# m by which distances of other joints from a joint at zero are wrong, and times those of others
_ELSEWHERE, _TWICE = 0.1, 2.0


def never_measured(estimate: Tensor, truth: Tensor, valid: Tensor) -> Iterator[int]:
    """Joints that a truth has at 0, 0, 0 in all frames, and that are not its origin.

    Other joints of a truth that is relative to a joint are as far from it as those of the result,
    or farther by one factor.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
    """
    zero = valid.any(0) & ((truth == 0).all(-1) | ~valid).all(0)
    others = valid & ~zero
    for joint in zero.nonzero()[:, 0].tolist():
        both = others & valid[:, joint, None]
        if bool(both.any()):
            true, own = (
                (points - points[:, joint, None]).norm(dim=-1)[both] for points in (truth, estimate)
            )
            larger = float(true.median()) / max(float(own.median()), _STILL)
            # a poor result, or a truth that is wrong otherwise, has all distances wrong
            usual = max(_ELSEWHERE * larger, _TWICE * _apart(estimate, truth, others))
            if float((true - larger * own).abs().median()) > usual:
                yield joint


def _apart(estimate: Tensor, truth: Tensor, valid: Tensor) -> float:
    """By how much distances between joints that count are wrong, m."""
    both = valid[:, :, None] & valid[:, None]
    true, own = (
        (points[:, :, None] - points[:, None]).norm(dim=-1)[both] for points in (truth, estimate)
    )
    return float((true - own * (true.median() / own.median().clamp(min=_STILL))).abs().median())


def said_of_zeros(joints: Sequence[int], named: Numbered) -> Iterator[str]:
    """A sentence for all joints that were never measured.

    Args:
        joints: which.
        named: what they are called.
    """
    if joints:
        names = ", ".join(named.joint(joint) for joint in joints)
        yield (
            f"the truth has {names} at 0, 0, 0 in all frames, and other joints are not around it; "
            "what was not measured is NaN, or left out"
        )


def repeats(estimate: Tensor, truth: Tensor, valid: Tensor, named: Numbered) -> Iterator[str]:
    """Frames that repeat the one before, or else joints that stay at one place.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
        named: what frames and joints are called.
    """
    repeated = list(_repeated(truth, valid))
    yield from repeated or _filled(estimate, truth, valid, named)


def _filled(estimate: Tensor, truth: Tensor, valid: Tensor, named: Numbered) -> Iterator[str]:
    """Single joints that a truth has at one place, to the last digit, while the result's move."""
    moved = (truth.diff(dim=0).norm(dim=-1) > _STILL) & valid[1:] & valid[:-1]
    awake = torch.cat((moved.any(-1), moved.new_zeros(1)))
    awake[1:] |= moved.any(-1)  # where all joints stay is told of frames
    found = []
    for joint in range(truth.shape[1]):
        rows = (valid[:, joint] & awake).nonzero()[:, 0]
        if len(rows):
            _, which, counts = torch.unique(
                truth[rows, joint], dim=0, return_inverse=True, return_counts=True
            )
            there = rows[which == counts.argmax()]
            way = (estimate[there, joint] - estimate[there[0], joint]).norm(dim=-1).max()
            if _ONE_PLACE <= len(there) < len(truth) and float(way) > _GOES:
                found.append(f"{named.joint(joint)} in {len(there)} frames")
    if found:
        said = ", ".join(found[:4]) + (f" and {len(found) - 4} more" if len(found) > 4 else "")
        yield (
            f"the truth has {said} at one place, to the last digit, while the result moves; were "
            "gaps filled with the last place, or the mean? Give what was measured there"
        )


def _repeated(truth: Tensor, valid: Tensor) -> Iterator[str]:
    """Two to four frames for each that was measured; longer stretches are told one by one."""
    known = valid[1:] & valid[:-1]
    counts = known.any(-1)
    moved = ((truth.diff(dim=0).norm(dim=-1) > _STILL) & known).any(-1)
    still = counts & ~moved
    total = int(counts.sum())
    ends = int((still[:-1] & moved[1:]).sum())
    repeated = int(still.sum())
    if total >= _FEWEST and repeated >= _REPEATED * total and ends >= _CHANGES * total:
        yield (
            f"{repeated} of {total + 1} frames of the truth are the one before, to a tenth of a "
            "millimetre, a few at a time: it was recorded at a lower rate; give a pose for every "
            "frame, as between those that were measured, and none twice"
        )
