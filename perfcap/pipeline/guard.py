"""A refinement never leaves a frame worse than it found it: measured, and taken back."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

Refined = TypeVar("Refined")

_FADE = 2  # frames over which a rejected frame's neighbours return to their refinement
_WORSE = 1e-3  # of overlap; rasterisation alone moves it by less


def keep_better(
    refined: Callable[[Tensor], Refined],
    overlaps: Callable[[Refined], NDArray[np.float64]],
    before: NDArray[np.float64],
) -> tuple[Refined, NDArray[np.float64], NDArray[np.bool_]]:
    """The refinement where it overlaps the masks at least as well as what was before.

    Frames in which it does not are given back, and their neighbours fade towards them. Fading can
    make a neighbour worse, which is then given back too: frames are only ever taken away, and what
    was before is left in the end.

    Args:
        refined: what comes of a share (F,) of the refinement in every frame, 0 to 1.
        overlaps: with the masks, (F,).
        before: overlap without the refinement, (F,).

    Returns:
        What is left of the refinement, its overlap (F,), and the frames that kept theirs, (F,).
    """
    kept = np.ones(len(before), np.bool_)
    while True:
        result = refined(_shares(kept))
        after = overlaps(result)
        worse = kept & (after < before - _WORSE)
        if not worse.any():
            return result, after, kept
        kept &= ~worse


def _shares(kept: NDArray[np.bool_]) -> Tensor:
    """0 in frames that are not kept, and ramps to 1 beside them, (F,) float64."""
    if kept.all():
        return torch.ones(len(kept), dtype=torch.float64)
    distance = ndimage.distance_transform_cdt(kept, "chessboard") if kept.any() else kept * 0
    return torch.from_numpy(np.minimum(distance / (_FADE + 1), 1.0))
