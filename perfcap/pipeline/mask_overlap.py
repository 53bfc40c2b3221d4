"""Whether masks lie where a captured person is."""

from __future__ import annotations

import warnings

import torch
from torch import Tensor

_EXAMINED = 5  # frames
_ELSEWHERE = 0.2  # intersection over union; captures have more than half


def examined(frames: int) -> Tensor:
    """A few frames, spread over a clip."""
    return torch.linspace(0, frames - 1, min(frames, _EXAMINED)).long()


def warn_of_masks_elsewhere(masks: Tensor, drawn: Tensor) -> None:
    """Warn of views whose masks the drawn person hardly meets.

    Args:
        masks: (F, C, H, W), bool or from 0 to 1.
        drawn: coverage of the ``examined`` frames, (F', C, H, W).
    """
    found = masks[examined(len(masks)).to(masks.device)] > 0.5
    shown = found.flatten(2).any(-1)[..., None, None]  # a mask may be missing
    model = (drawn > 0.5) & shown
    both, either = ((each.sum((0, 2, 3))) for each in (found & model, found | model))
    share = both / either.clamp(min=1)
    elsewhere = ((share < _ELSEWHERE) & (either > 0)).nonzero().flatten().tolist()
    if elsewhere:
        worst = float(share[elsewhere].min())
        warnings.warn(
            f"masks of views {elsewhere} overlap the captured person by {worst:.0%} only; check "
            "that they are of these frames, not inverted, mirrored or transposed, and that cameras "
            "are in their pixels",
            stacklevel=3,
        )
