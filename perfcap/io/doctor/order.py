"""Whether frames came in the order of their names as text: 1, 10, 11, 2."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.io.doctor.finding import Finding, Severity

_SURE = 0.3  # confidence
_FEWEST = 20  # frames: who swings back within a dozen is as near in another order
_SHORTER = 0.7  # of the way as given; of noise alone it is the same
_PAIRS = 6  # frames after one another that both show the person


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


def _way(pixels: Tensor, confidence: Tensor) -> float:
    """Mean over frames of the median step of a joint, px; NaN of too few."""
    sure = confidence > _SURE
    both = sure[1:] & sure[:-1]
    steps = torch.where(both, pixels.diff(dim=0).norm(dim=-1), torch.nan).nanmedian(-1).values
    known = steps[steps.isfinite()]
    return float(known.mean()) if len(known) >= _PAIRS else float("nan")
