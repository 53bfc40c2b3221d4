"""Doubts of a performance that is to be saved: parts that were replaced and do not belong to it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from perfcap.io.doctor.evidence import beside
from perfcap.pipeline.presets import CaptureConfig
from perfcap.pipeline.surface import surface_doubts
from perfcap.rates import rate_doubts

if TYPE_CHECKING:
    from perfcap.pipeline.performance import Performance

_ELSEWHERE = 0.1  # of the person's box, in the median: what captures that went well are far below


def saved_doubts(performance: Performance) -> Iterator[str]:
    """A sentence for each part that is not of the same frames, world or unit as the others.

    Args:
        performance: as it is to be saved.
    """
    yield from rate_doubts(performance.rate)
    if isinstance(performance.config, CaptureConfig):
        yield from _elsewhere(performance)
    if performance.surface is not None:
        yield from surface_doubts(performance.surface, performance.actor, performance.motion)


def _elsewhere(performance: Performance) -> Iterator[str]:
    """Whether cameras see the motion elsewhere than joints were detected."""
    cameras, seen = performance.cameras, performance.detections
    if seen.frame_count != performance.frames or seen.views != cameras.views:
        return
    if cameras.moving and len(cameras.rotation) != performance.frames:
        return
    off = beside(cameras, seen, performance.joints())
    usual = float(off.nanmedian())
    if usual > _ELSEWHERE:
        yield (
            f"the cameras see the motion {usual:.0%} of the person's size from the joints it was "
            "captured from: expected those of the same frames, in metres, in the world of the "
            "cameras; replace motion, cameras and detections together"
        )
