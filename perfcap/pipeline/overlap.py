"""How well a surface overlaps the masks of a clip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from perfcap.pipeline.checkpoint import ARRAY, NOTHING, Kept
from perfcap.pipeline.evidence import Evidence
from perfcap.pipeline.sight import Sight, View
from perfcap.pipeline.surface import SurfaceFrames

BLOCK = 8  # frames drawn at once


def blocks(start: int, stop: int) -> list[range]:
    """Frames from ``start`` to ``stop``, as many at a time as are drawn at once."""
    return [range(first, min(first + BLOCK, stop)) for first in range(start, stop, BLOCK)]


def frame_overlaps(
    drawn: Sequence[Sequence[View]], evidence: Evidence, frames: range
) -> NDArray[np.float64]:
    """Intersection over union of drawn surfaces ``[f][C]`` with masks, the mean over views, (f,).

    A view in which there is neither counts as 1. What somebody else hides counts for nothing.
    """
    pairs = zip(drawn, frames, strict=True)
    return np.array([np.mean(list(_overlaps(views, evidence, f))) for views, f in pairs])


def _overlaps(drawn: Sequence[View], evidence: Evidence, frame: int) -> Iterator[float]:
    unknown = evidence.unknown(frame)
    for number, (view, mask) in enumerate(zip(drawn, evidence.masks(frame), strict=True)):
        seen, part = view.seen, view.part
        if unknown is not None:
            seen = seen & ~unknown[number][part]
        both = np.count_nonzero(seen & mask[part])
        either = np.count_nonzero(seen) + np.count_nonzero(mask) - both
        yield both / either if either else 1.0


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
        return frame_overlaps(sight.look(surface[span], span), evidence, frames)

    parts = kept.each(ARRAY, overlaps, blocks(0, surface.frames), workers)
    return np.array(list(chain.from_iterable(parts)))
