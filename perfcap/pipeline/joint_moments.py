"""Whether rotations and positions of joints are of the same moments."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

_FAR = 15.0  # degrees that one limb in twenty may be off; right recordings have none
_LATE = 5.0  # degrees; less of them is named where a shift explains it: a frame of a slow walk
_OTHERWISE = 30.0  # degrees of half of the limbs: rotations of something else, at any moment
_LEFT = 1 / 3  # of the degrees, at most, where a shift explains them
_ALIKE = 10.0  # degrees left, at most: more than noise leaves, less than another walk
_LONGEST = 0.5  # s of a shift
_SHARE = 3  # of the frames, a third at most, are shifted out of the clip
_MEAN = 5  # frames whose mean direction counts: noise of single frames counts less
_ENOUGH = 2000  # frames that shifts are looked for in


def moment_doubts(carried: Tensor, shown: Tensor, rate: float) -> Iterator[str]:
    """What is odd about limbs as rotations and as positions have them.

    Args:
        carried: along the limbs, turned by rotations, (F, L, 3), any lengths.
        shown: between joints at their positions, (F, L, 3), likewise.
        rate: frames a second.
    """
    smooth, seen = _smoothed(carried), _smoothed(shown)
    off = _most(smooth, seen)
    if off <= _LATE:
        return
    usual = _most(carried, shown, share=0.5)
    most = _most(carried, shown)
    far = f"rotations take one limb in twenty {most:.0f} degrees or more off its joints' line"
    shift, left = _shift(smooth[:_ENOUGH], seen[:_ENOUGH], max(1, round(_LONGEST * rate)))
    alike = min(_LEFT * off, _ALIKE)
    if shift and left < alike:
        frames = f"{abs(shift)} frame" + ("s" if abs(shift) > 1 else "")
        yield (
            f"positions show moments about {frames} {'later' if shift > 0 else 'earlier'} than "
            f"rotations of the same rows ({far}); give both of the same frames"
        )
    elif off > _FAR and _most(smooth, seen.flip(0)) < alike:
        yield f"positions run backwards as against rotations ({far}); give both in one order"
    elif usual > _OTHERWISE:
        yield (
            f"rotations take the source's limbs {usual:.0f} degrees from where its joints are; "
            "expected rest-to-posed rotations in the world, which turn columns, and positions of "
            "the same frames of one clip"
        )
    elif off > _FAR:
        yield f"{far}; expected both of the same frames of one clip, and of this source"


def _smoothed(limbs: Tensor) -> Tensor:
    """Directions of limbs (F, L, 3), mean of a few frames; both kinds alike, so none is late."""
    unit = torch.nn.functional.normalize(limbs, dim=-1)
    width = min(_MEAN, len(unit))
    return unit.unfold(0, width, 1).mean(-1)


def _most(one: Tensor, other: Tensor, share: float = 0.05) -> float:
    """Degrees between directions (F, L, 3), all but the largest share of frames and limbs."""
    cosine = torch.nn.functional.cosine_similarity(one, other, dim=-1).clamp(-1, 1).flatten()
    least = cosine.kthvalue(max(1, round(share * len(cosine)))).values
    return float(torch.rad2deg(torch.acos(least)))


def _shift(carried: Tensor, shown: Tensor, longest: int) -> tuple[int, float]:
    """Frames by which shown limbs (F, L, 3) are later than carried ones, and degrees left then."""
    count = len(shown)
    longest = min(longest, count // _SHARE)
    left = {
        # a row that shows a later moment is like a later row of the other
        by: _most(carried[max(0, by) : count + min(0, by)], shown[max(0, -by) : count - max(0, by)])
        for by in range(-longest, longest + 1)
    }
    best = min(left, key=lambda by: (left[by], abs(by)))
    return best, left[best]
