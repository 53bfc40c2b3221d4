"""Joints and poses of a truth that are copies of others."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.metrics.mismatch_parts import Numbered

_APART = 0.02  # m between joints of the result of which the truth has one place
_SHARE = 0.5  # of the frames in which both are known
_STILL = 1e-4  # m
_REPEATED, _CHANGES = 1 / 3, 1 / 6  # of the frames: repeated ones, and those that end a repetition
_FEWEST = 12  # frames


def copies(estimate: Tensor, truth: Tensor, valid: Tensor, named: Numbered) -> Iterator[str]:
    """Joints that lie on another one, and frames that repeat the one before.

    Args:
        estimate: joints (F, J, 3), metres.
        truth: the same.
        valid: joints that count, (F, J).
        named: what frames and joints are called.
    """
    both = valid[:, :, None] & valid[:, None]  # F J J
    same = both & (truth[:, :, None] == truth[:, None]).all(-1)
    apart = (estimate[:, :, None] - estimate[:, None]).norm(dim=-1) > _APART
    shown, shared = both.sum(0), (same & apart).sum(0)
    pairs = torch.triu((shown > 0) & (shared > _SHARE * shown), diagonal=1).nonzero().tolist()
    if pairs:
        said = ", ".join(f"{named.joint(one)} and {named.joint(other)}" for one, other in pairs[:4])
        said += f" and {len(pairs) - 4} more pairs" if len(pairs) > 4 else ""
        yield (
            f"the truth has {said} at one place, to the last digit: one is a copy, and its error "
            "says nothing; give the places that were measured, or look at per_joint_mm alone"
        )
    yield from _repeated(truth, valid)


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
