"""The frame that a page opens with: one that is trusted and shows the person well."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.report.marks import Mark

_EQUAL = 0.02  # of trust times visible share: frames that are as good as the best one


def opening_frame(
    frames: int,
    trust: NDArray[np.float64] | None,
    arrays: dict[str, NDArray[Any]],
    views: Sequence[dict[str, Any]],
    marks: Sequence[Mark],
    first: int,
) -> int:
    """Index of a frame, counted from the first shown one.

    The best ones have the largest product of trust and the share of joints inside the images (mean
    over views, as far as there are cameras); of those it is the one with the person largest. Frames
    that are not captured or show nobody come last; without trust and cameras it is frame 0.

    Args:
        frames: F.
        trust: (F,), 0 to 1, or None.
        arrays: ``joints2d-K`` of view K, (F, 16, 2), pixels of the shown videos.
        views: their heights and widths.
        marks: stretches that stand out.
        first: number of the first shown frame in the video.
    """
    score = np.ones(frames) if trust is None else np.nan_to_num(trust, nan=0.0).astype(np.float64)
    seen = [
        _seen(arrays[f"joints2d-{view}"], size)
        for view, size in enumerate(views)
        if f"joints2d-{view}" in arrays
    ]
    extent = np.zeros(frames)
    if seen:
        score = score * np.mean([share for share, _ in seen], axis=0)
        extent = np.mean([size for _, size in seen], axis=0)
    for mark in marks:
        if mark.kind == "bad":
            score[mark.start - first : mark.stop - first] = -1.0
    best = score >= score.max() - _EQUAL
    return int(np.argmax(np.where(best, extent, -1.0)))


def _seen(
    pixels: NDArray[Any], size: dict[str, Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of the joints inside an image, and how much of its height or width they take."""
    with np.errstate(invalid="ignore"):
        inside = np.logical_and(pixels > 0, pixels < (size["width"], size["height"]))
    both = np.all(inside, axis=-1)  # F J
    known = np.where(both[..., None], pixels, np.nan)
    reach = np.zeros(len(pixels))
    some = both.sum(-1) > 1
    span = np.nanmax(known[some], 1) - np.nanmin(known[some], 1)
    reach[some] = (span / (size["width"], size["height"])).max(-1)
    return both.mean(-1), reach
