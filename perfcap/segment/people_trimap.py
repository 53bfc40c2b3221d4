"""Regions around several people in one image: each one's own, and those of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.segment.trimap import (
    BACKGROUND,
    FOREGROUND,
    PROBABLE_BACKGROUND,
    PROBABLE_FOREGROUND,
    Box,
    Mask,
    Trimap,
    TrimapSettings,
    build_trimap,
    extent,
)

# labels by how much they say for foreground
_RANKED = np.array(
    [BACKGROUND, PROBABLE_BACKGROUND, PROBABLE_FOREGROUND, FOREGROUND], dtype=np.uint8
)
_RANK = np.argsort(_RANKED).astype(np.uint8)


def trimap_of(
    model: Mask,
    bones: NDArray[np.floating],
    settings: TrimapSettings | None = None,
    feet: Sequence[int] = (),
) -> Trimap:
    """Regions around one model (H, W), as ``build_trimap``; or around several, (K, H, W).

    Args:
        model: silhouettes of posed models.
        bones: of one (B, 2, 2) px, or of each, (K, B, 2, 2).
        settings: widths.
        feet: which of a person's bones lead from an ankle to the toes.
    """
    if model.ndim == 2:
        return build_trimap(model, bones, settings, feet=feet)
    return joined(own_trimaps(model, bones, settings, feet))


def own_trimaps(
    models: Mask,
    bones: NDArray[np.floating],
    settings: TrimapSettings | None = None,
    feet: Sequence[int] = (),
) -> tuple[Trimap, ...]:
    """Regions around each of K people, all of the same box, which holds everybody.

    Widths are shares of each person's own size. Whoever is not in the image has size 0.

    Args:
        models: silhouettes of their posed models, each as if alone, (K, H, W).
        bones: of their skeletons, (K, B, 2, 2) px.
        settings: widths.
        feet: which of a person's bones lead from an ankle to the toes.

    Raises:
        InputError: arrays of other shapes.
    """
    if models.ndim != 3 or not len(models) or len(bones) != len(models):
        raise InputError(
            f"models: have shape {models.shape} beside {len(bones)} skeletons, expected masks "
            "(K, H, W) and bones (K, B, 2, 2) of K people"
        )
    settings = settings or TrimapSettings()
    boxes = [box for size, box in (extent(model, settings) for model in models) if size]
    box = _around(boxes) if boxes else (slice(0, 0), slice(0, 0))
    pairs = zip(models, bones, strict=True)
    return tuple(build_trimap(*pair, settings, box, feet) for pair in pairs)


def joined(trimaps: Sequence[Trimap]) -> Trimap:
    """Regions of everybody: surely somebody, perhaps somebody, surely nobody.

    Sizes are those of the largest person; the distance is that to the nearest outline.
    """
    largest = max(trimaps, key=lambda each: each.size)
    labels = _RANKED[np.max([_RANK[each.labels] for each in trimaps], 0)]
    distance = np.max([each.distance for each in trimaps], 0)
    shaded = [each.contact for each in trimaps if each.contact is not None]
    contact: Mask | None = np.any(shaded, 0) if shaded else None
    people = tuple(trimaps)
    return replace(largest, labels=labels, distance=distance, contact=contact, people=people)


def _around(boxes: Sequence[Box]) -> Box:
    rows, columns = (
        slice(min(box[axis].start for box in boxes), max(box[axis].stop for box in boxes))
        for axis in range(2)
    )
    return rows, columns
