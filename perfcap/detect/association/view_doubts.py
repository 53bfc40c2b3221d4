"""Views in each other's place, sides swapped in one, other pixels: people fit better without."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import torch
from torch import Tensor

from perfcap.detect.association.grouping import group_views
from perfcap.detect.association.sightings import AssociationConfig, Sightings
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.detect.view_words import view_words
from perfcap.geometry.camera import Camera

_LOOKED_AT = 24  # images, of a frame and view each
_FEWEST = 4  # frames
_SHORTEST = 6  # frames of a clip; right views of fewer fitted better when exchanged, now and then
_BETTER = 1.2  # times as well
_SIZES = {2.0: "half", 1.5: "two thirds of", 2 / 3: "one and a half times", 0.5: "twice"}
_OTHER_SIDE = list(LANDMARKS16.mirrored())


def view_doubts(
    cameras: Camera,
    candidates: Detections,
    config: AssociationConfig,
    names: Sequence[str] | None = None,
) -> tuple[str, ...]:
    """What looks wrong with the views, one sentence at most.

    Args:
        cameras: C views, (C,) or (F, C).
        candidates: (P, F, C, 16), float64; a few frames, evenly spread, are looked at.
        config: sizes.
        names: of the views; they are counted from 0 without.
    """
    frames, views = candidates.joints2d.shape[1:3]
    if frames < _SHORTEST:
        return ()
    count = min(frames, max(_FEWEST, _LOOKED_AT // views))
    index = torch.linspace(0, frames - 1, count).round().long()
    cameras, some = cameras.frames(index), candidates.frames(index)
    sizes = _SIZES if config.resized else {}
    as_given = {scale: _as_given(cameras, some, config, scale) for scale in (1.0, *sizes)}
    better = {
        what: fit
        for what, other, scale in _without_mistake(some, sizes, names)
        if (fit := _fit(Sightings.of(cameras, other, config))) > _BETTER * as_given[scale]
    }
    # all that is smaller fits better: a view is only taken to be too large if none is too small
    for resized in (_one_resized(some, sizes, names, larger) for larger in (True, False)):
        fits = {what: _fit(Sightings.of(cameras, other, config)) for what, other in resized}
        better |= {what: fit for what, fit in fits.items() if fit > _BETTER * as_given[1.0]}
        if better.keys() & fits:
            break
    return (max(better, key=better.__getitem__),) if better else ()


def _as_given(
    cameras: Camera, candidates: Detections, config: AssociationConfig, scale: float
) -> float:
    """The fit without a change, but to people who are ``1 / scale`` as large, and so are errors:
    else any detections fit better the smaller they are.
    """
    larger = replace(config, same=config.same / scale)
    return _fit(Sightings.of(cameras, candidates, larger))


def _without_mistake(
    candidates: Detections, sizes: Mapping[float, str], names: Sequence[str] | None
) -> Iterator[tuple[str, Detections, float]]:
    """Each mistake in words, the candidates if it was made, and how much larger people then are."""
    views = candidates.views
    for first, second in combinations(range(views), 2):
        order = list(range(views))
        order[first], order[second] = second, first
        yield (
            f"{view_words([first, second], names)} look exchanged: give detections, videos "
            "and cameras in one order",
            candidates.select(order),
            1.0,
        )
    for view in range(views):
        number = f"view {view} (counted from 0)" if names is None else f"view {names[view]}"
        which = number if views > 2 else "one of the views"
        joints, confidence = candidates.joints2d.clone(), candidates.confidence2d.clone()
        joints[..., view, :, :] = joints[..., view, _OTHER_SIDE, :]
        confidence[..., view, :] = confidence[..., view, _OTHER_SIDE]
        yield (
            f"left and right joints look swapped in {which}: check for a mirrored "
            "video (front camera) or swapped joint names",
            replace(candidates, joints2d=joints, confidence2d=confidence),
            1.0,
        )

    for scale, size in sizes.items():
        yield (
            f"detections look as if they were in pixels of videos of {size} the size: give them in "
            f"pixels of the calibration, {scale:.3g} times theirs",
            replace(candidates, joints2d=scale * candidates.joints2d),
            scale,
        )


def _one_resized(
    candidates: Detections, sizes: Mapping[float, str], names: Sequence[str] | None, larger: bool
) -> Iterator[tuple[str, Detections]]:
    """Likewise of the pixels of one view; of two, either may be the wrong one."""
    for view in range(candidates.views if candidates.views > 2 else 0):
        for scale in (each for each in sizes if (each > 1) == larger):
            joints = candidates.joints2d.clone()
            joints[..., view, :, :] *= scale
            yield (
                f"detections of {view_words([view], names)} look as if they were in pixels of a "
                f"video of {sizes[scale]} the size: give them in pixels of the calibration, "
                f"{scale:.3g} times theirs",
                replace(candidates, joints2d=joints),
            )


def _fit(sightings: Sightings) -> float:
    """How many detections are of people, each counted by how well its rays cross, 0 to 1.

    Rays of fewer views cross better whatever they show, and are judged as those of all views.
    """
    groups = group_views(sightings)
    if not len(groups.frames):
        return 0.0
    members = torch.from_numpy(groups.members)
    misfit = sightings.cross(torch.from_numpy(groups.frames), members).misfit
    seen = (members >= 0).sum(1)
    views = torch.tensor(members.shape[1])
    share = (1 - misfit * _spread(seen) / _spread(views) / sightings.config.same).clamp(min=0)
    return float((share * seen).sum() / sightings.there.sum())


def _spread(views: Tensor) -> Tensor:
    """Of places about where rays cross: a view gives two numbers, a point takes three."""
    return (2 * views / (2 * views - 3)).sqrt()
