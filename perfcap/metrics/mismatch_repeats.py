"""Poses of a truth that repeat the one before, and joints of it that stay at one place."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.metrics.mismatch_named import Numbered

_STILL = 1e-4  # m
_REPEATED, _CHANGES = 1 / 3, 1 / 6  # of the frames: repeated ones, and those that end a repetition
_FEWEST = 12  # frames
# Frames in which a joint has one place, and m that the result's goes there: a foot that stands on
# one place in the truth is not that far off
_ONE_PLACE, _GOES = 5, 0.1


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
