"""Whether two views are given in each other's place: people fit together far better exchanged."""

from __future__ import annotations

from itertools import combinations

import torch

from perfcap.detect.association.grouping import group_views
from perfcap.detect.association.sightings import AssociationConfig, Sightings
from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera

_LOOKED_AT = 24  # images, of a frame and view each
_FEWEST = 4  # frames
_BETTER = 1.2  # times as well; of views in their order no exchange was more than 0.83 times as good


def exchanged_views(
    cameras: Camera, candidates: Detections, config: AssociationConfig
) -> tuple[int, int] | None:
    """Two views whose detections fit the others' far better in each other's place, if any.

    Args:
        cameras: C views, (C,) or (F, C).
        candidates: (P, F, C, 16), float64; a few frames, evenly spread, are looked at.
        config: sizes.
    """
    frames, views = candidates.joints2d.shape[1:3]
    count = min(frames, max(_FEWEST, _LOOKED_AT // views))
    index = torch.linspace(0, frames - 1, count).round().long()
    cameras, some = cameras.frames(index), candidates.frames(index)
    pairs = list(combinations(range(views), 2))
    given = _fit(Sightings.of(cameras, some, config))
    fits = [
        _fit(Sightings.of(cameras, some.select(_exchanged(views, *pair)), config)) for pair in pairs
    ]
    best = max(range(len(pairs)), key=fits.__getitem__)
    return pairs[best] if fits[best] > _BETTER * given else None


def _fit(sightings: Sightings) -> float:
    """How many detections are of people, each counted by how well its rays cross, 0 to 1."""
    groups = group_views(sightings)
    if not len(groups.frames):
        return 0.0
    members = torch.from_numpy(groups.members)
    misfit = sightings.cross(torch.from_numpy(groups.frames), members).misfit
    share = (1 - misfit / sightings.config.same).clamp(min=0)
    return float((share * (members >= 0).sum(1)).sum() / sightings.there.sum())


def _exchanged(views: int, first: int, second: int) -> list[int]:
    order = list(range(views))
    order[first], order[second] = second, first
    return order
