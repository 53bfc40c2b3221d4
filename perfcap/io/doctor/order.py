"""Whether frames came in the order of their names as text: 1, 10, 11, 2; or in none at all."""

from __future__ import annotations

from statistics import fmean

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity

_SURE = 0.3  # confidence
_FEWEST = 20  # frames: who swings back within a dozen is as near in another order
_SHORTER = 0.7  # of the way as given; of noise alone it is the same
_PAIRS = 6  # frames after one another that both show the person
# Steps of a joint from frame to frame, of those between frames in any order: 0.68 at most in parts
# of 12 frames and more of ten recordings, 0.72 in parts of eight in which the person moves so far
_SHUFFLED = 0.85
# Of the person's height, between frames in any order, by frames: less may be errors of joints
_MOVED = {12: 0.05, 8: 0.1}
_ORDERS = 4  # that are tried


def examine_order(name: str, pixels: Tensor, confidence: Tensor) -> list[Finding]:
    """Say so where joints go clearly less far once frames are sorted by their numbers.

    Args:
        name: of the view.
        pixels: joints, (F, 16, 2).
        confidence: (F, 16).
    """
    count = len(pixels)
    if count < _FEWEST:
        return []
    given = _way(pixels, confidence)
    for start in (0, 1):  # of the numbers in the names
        numbers = sorted(range(start, start + count), key=str)
        back = torch.tensor(numbers).argsort().to(pixels.device)
        way = _way(pixels[back], confidence[back])
        if way < _SHORTER * given:
            what = (
                "frames look sorted as text (1, 10, 2): by their numbers joints go "
                f"{way / given:.0%} as far"
            )
            return [Finding(Severity.WARNING, name, what, "sort names by the numbers in them")]
    return []


def examine_shuffled(name: str, joints: Tensor, confidence: Tensor) -> list[Finding]:
    """Say so where joints go as far from one frame to the next as between any two frames.

    Args:
        name: of the view.
        joints: in an image or in space, (F, 16, D).
        confidence: (F, 16).
    """
    count, height = len(joints), _height(joints, confidence)
    moved = next((share for least, share in _MOVED.items() if count >= least), torch.inf)
    if not 0 < moved * height < torch.inf:
        return []
    random = torch.Generator().manual_seed(0)
    orders = [torch.randperm(count, generator=random).to(joints.device) for _ in range(_ORDERS)]
    mixed = fmean(_way(joints[order], confidence[order]) for order in orders)
    given = _way(joints, confidence)
    if not (mixed > moved * height and given > _SHUFFLED * mixed):
        return []
    what = (
        "frames look like images that do not follow one another: from each to the next joints go "
        f"{given / mixed:.0%} as far as between any two"
    )
    remedy = (
        "give successive frames of one clip; single images, as of a shuffled batch, are clips of "
        "one frame each (B, 1, C, ...), and joints that are noise alone look alike"
    )
    return [Finding(Severity.WARNING, name, what, remedy)]


def _height(joints: Tensor, confidence: Tensor) -> float:
    """Median size of the person along y; NaN where no joint is sure."""
    sure, along = confidence > _SURE, joints[..., 1]
    low = along.where(sure, torch.inf).amin(-1)
    high = along.where(sure, -torch.inf).amax(-1)
    return float((high - low)[sure.any(-1)].median()) if bool(sure.any()) else float("nan")


def _way(pixels: Tensor, confidence: Tensor) -> float:
    """Mean over frames of the median step of a joint, in their unit; NaN of too few."""
    sure = confidence > _SURE
    both = sure[1:] & sure[:-1]
    steps = torch.where(both, pixels.diff(dim=0).norm(dim=-1), torch.nan).nanmedian(-1).values
    known = steps[steps.isfinite()]
    return float(known.mean()) if len(known) >= _PAIRS else float("nan")
