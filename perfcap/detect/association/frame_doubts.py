"""Frames of several people in no order: no person is near where one was a frame before."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.frame_order import SURE, Steps, Way, in_no_order, person_height, sorted_as_text

# Frames. Who is missed goes to somebody else in any order: where a third of frames and views has
# mistakes, right frames go up to 0.84 as far as those in no order in 12 frames, 0.67 in 20
_FEWEST = 20
_PAIRS = 6  # people in a frame and view who are seen in the next as well


def frame_doubts(candidates: Detections) -> Iterator[str]:
    """What looks wrong with the order of frames, one sentence at most.

    Args:
        candidates: (P, F, C, 16), float64.
    """
    way, count = _way(candidates), candidates.frame_count
    if count < _FEWEST:
        return
    share = sorted_as_text(way, count)
    if share is not None:
        yield (
            "frames look sorted as text (1, 10, 2): by their numbers people go "
            f"{share:.0%} as far; sort names by the numbers in them"
        )
        return
    height = person_height(candidates.joints2d, candidates.confidence2d)
    share = in_no_order(way, count, height)
    if share is not None:
        yield (
            "frames look like images that do not follow one another: from each to the next people "
            f"go {share:.0%} as far as between any two; give successive frames of one clip"
        )


def _way(candidates: Detections) -> Way:
    """Of everybody the median step of joints to who is nearest in the next frame, px.

    Slots mean nothing: who is who from one frame to the next is not known.
    """
    joints = candidates.joints2d
    sure = (candidates.confidence2d > SURE) & joints.isfinite().all(-1)

    def way(order: Tensor) -> Steps:
        here, there = (joints[:, part] for part in (order[:-1], order[1:]))  # P F-1 C 16 2
        seen, then = (sure[:, part] for part in (order[:-1], order[1:]))
        nearest = []
        for one, known in zip(here, seen, strict=True):
            steps = [
                torch.where(known & also, (one - other).norm(dim=-1), torch.nan).nanmedian(-1)
                for other, also in zip(there, then, strict=True)
            ]
            every = torch.stack([step.values for step in steps])
            nearest.append(every.nan_to_num(torch.inf).amin(0))
        every = torch.stack(nearest)
        every = every[every.isfinite()]
        return Steps(float(every.mean()) if len(every) >= _PAIRS else float("nan"), len(every))

    return way
