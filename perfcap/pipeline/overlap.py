"""How well a surface overlaps the masks of a clip."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from perfcap.metrics import mask_overlap
from perfcap.pipeline.checkpoint import ARRAY, NOTHING, Kept
from perfcap.pipeline.evidence import Evidence, Mask
from perfcap.pipeline.sight import Sight, View
from perfcap.pipeline.surface import SurfaceFrames

BLOCK = 8  # frames drawn at once


def blocks(start: int, stop: int) -> list[range]:
    """Frames from ``start`` to ``stop``, as many at a time as are drawn at once."""
    return [range(first, min(first + BLOCK, stop)) for first in range(start, stop, BLOCK)]


def frame_overlaps(
    drawn: Sequence[Sequence[View]], masks: Sequence[Sequence[Mask]]
) -> NDArray[np.float64]:
    """Intersection over union of drawn surfaces ``[f][C]`` with masks, the mean over views, (f,).

    A view in which there is neither counts as 1.
    """
    rows = zip(drawn, masks, strict=True)
    pairs = (zip(views, of_frame, strict=True) for views, of_frame in rows)
    return np.array([np.mean([mask_overlap(v.mask, m).iou for v, m in row]) for row in pairs])


def clip_overlaps(
    surface: SurfaceFrames,
    sight: Sight,
    evidence: Evidence,
    workers: int | None = None,
    kept: Kept = NOTHING,
) -> NDArray[np.float64]:
    """The same of every frame of a clip, (F,)."""

    def overlaps(frames: range) -> NDArray[np.float64]:
        span = slice(frames.start, frames.stop)
        return frame_overlaps(sight.look(surface[span], span), [evidence.masks(f) for f in frames])

    parts = kept.each(ARRAY, overlaps, blocks(0, surface.frames), workers)
    return np.array(list(chain.from_iterable(parts)))
