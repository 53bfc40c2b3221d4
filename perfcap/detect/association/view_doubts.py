"""Views in each other's place, sides swapped in one, other pixels: people fit better without."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import torch

from perfcap.detect.association.grouping import group_views
from perfcap.detect.association.sightings import AssociationConfig, Sightings
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.camera import Camera

_LOOKED_AT = 24  # images, of a frame and view each
_FEWEST = 4  # frames
_BETTER = 1.2  # times as well; of right views no such change was more than 0.83 times as good
_SIZES = {2.0: "half", 1.5: "two thirds of", 2 / 3: "one and a half times", 0.5: "twice"}
_OTHER_SIDE = list(LANDMARKS16.mirrored())


def view_doubts(
    cameras: Camera, candidates: Detections, config: AssociationConfig
) -> tuple[str, ...]:
    """What looks wrong with the views, one sentence at most.

    Args:
        cameras: C views, (C,) or (F, C).
        candidates: (P, F, C, 16), float64; a few frames, evenly spread, are looked at.
        config: sizes.
    """
    frames, views = candidates.joints2d.shape[1:3]
    count = min(frames, max(_FEWEST, _LOOKED_AT // views))
    index = torch.linspace(0, frames - 1, count).round().long()
    cameras, some = cameras.frames(index), candidates.frames(index)
    given = _fit(Sightings.of(cameras, some, config))
    fits = {
        what: _fit(Sightings.of(cameras, other, config)) for what, other in _without_mistake(some)
    }
    what = max(fits, key=fits.__getitem__)
    return (what,) if fits[what] > _BETTER * given else ()


def _without_mistake(candidates: Detections) -> Iterator[tuple[str, Detections]]:
    """Each mistake in words, and the candidates if it was made."""
    views = candidates.views
    for first, second in combinations(range(views), 2):
        order = list(range(views))
        order[first], order[second] = second, first
        yield (
            f"views {first} and {second}, counted from 0, look exchanged: give detections, videos "
            "and cameras in one order",
            candidates.select(order),
        )
    for view in range(views):
        which = f"view {view} (counted from 0)" if views > 2 else "one of the views"
        joints, confidence = candidates.joints2d.clone(), candidates.confidence2d.clone()
        joints[..., view, :, :] = joints[..., view, _OTHER_SIDE, :]
        confidence[..., view, :] = confidence[..., view, _OTHER_SIDE]
        yield (
            f"left and right joints look swapped in {which}: check for a mirrored "
            "video (front camera) or swapped joint names",
            replace(candidates, joints2d=joints, confidence2d=confidence),
        )

    for scale, size in _SIZES.items():
        yield (
            f"detections look as if they were in pixels of videos of {size} the size: give them in "
            f"pixels of the calibration, {scale:.3g} times theirs",
            replace(candidates, joints2d=scale * candidates.joints2d),
        )


def _fit(sightings: Sightings) -> float:
    """How many detections are of people, each counted by how well its rays cross, 0 to 1."""
    groups = group_views(sightings)
    if not len(groups.frames):
        return 0.0
    members = torch.from_numpy(groups.members)
    misfit = sightings.cross(torch.from_numpy(groups.frames), members).misfit
    share = (1 - misfit / sightings.config.same).clamp(min=0)
    return float((share * (members >= 0).sum(1)).sum() / sightings.there.sum())
