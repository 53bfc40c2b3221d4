"""Detections of one frame that are of one person: the views put together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.association.sightings import Crossing, Sightings

Indices = NDArray[np.int64]

_FARTHER = 4  # views beyond two for which patience grows


@dataclass(frozen=True)
class Groups:
    """People of each frame, seen by two views or more.

    Attributes:
        frames: the frame of each group, ascending, (N,).
        members: slot of each view, -1 where a view does not show the person, (N, C).
        points: joints in the world, (N, J, 3) m, NaN where unknown.
    """

    frames: Indices
    members: Indices
    points: NDArray[np.float64]

    @property
    def support(self) -> Indices:
        """Number of views of each group, (N,)."""
        views: Indices = (self.members >= 0).sum(1)
        return views

    def of(self, frame: int) -> Indices:
        """Rows of the groups of a frame."""
        start, stop = np.searchsorted(self.frames, (frame, frame + 1))
        return np.arange(start, stop)


def group_views(sightings: Sightings) -> Groups:
    """Put views together, frame for frame, by constrained agglomeration.

    Every detection begins alone. In each frame the two groups whose rays cross best become one,
    as long as they are of different views and cross well enough. All frames do so side by side.
    """
    frames, views, slots = (i.numpy() for i in torch.nonzero(sightings.there, as_tuple=True))
    members = np.full((len(frames), sightings.plane.shape[1]), -1)
    members[np.arange(len(frames)), views] = slots
    state = _Agglomeration(sightings, frames, members)
    while state.merge():
        pass
    return _apart(sightings, *state.found())


class _Agglomeration:
    """Groups of all frames, alive until they are merged, and what each pair would cost."""

    def __init__(self, sightings: Sightings, frames: Indices, members: Indices) -> None:
        self.sightings = sightings
        self.frames, self.members = frames, members
        self.alive = np.ones(len(frames), bool)
        self.pairs = np.zeros((0, 2), np.int64)
        self.costs = np.zeros(0)
        self._add(_pairs_within(frames))

    def merge(self) -> bool:
        """Merge the best pair of every frame; whether there was any."""
        if not len(self.costs):
            return False
        owner = self.frames[self.pairs[:, 0]]
        order = np.lexsort((self.costs, owner))
        best = order[np.unique(owner[order], return_index=True)[1]]
        one, other = self.pairs[best].T
        merged = np.maximum(self.members[one], self.members[other])
        self.alive[one] = self.alive[other] = False
        first = len(self.frames)
        self.frames = np.concatenate((self.frames, self.frames[one]))
        self.members = np.concatenate((self.members, merged))
        self.alive = np.concatenate((self.alive, np.ones(len(best), bool)))
        kept = self.alive[self.pairs].all(1)
        self.pairs, self.costs = self.pairs[kept], self.costs[kept]
        self._add(self._with(np.arange(first, len(self.frames))))
        return True

    def found(self) -> tuple[Indices, Indices]:
        """Frames and members of the groups of two views or more."""
        several = self.alive & ((self.members >= 0).sum(1) >= 2)
        order = np.argsort(self.frames[several], kind="stable")
        return self.frames[several][order], self.members[several][order]

    def _with(self, new: Indices) -> Indices:
        """Pairs of new groups, one a frame, with the others of their frames."""
        row = np.full(int(self.frames.max()) + 1, -1)
        row[self.frames[new]] = new
        others = np.flatnonzero(self.alive)
        partner = row[self.frames[others]]
        kept = (partner >= 0) & (partner != others)
        return np.stack((others[kept], partner[kept]), 1)

    def _add(self, pairs: Indices) -> None:
        """Pairs of groups of different views that may be one person."""
        config = self.sightings.config
        both = np.any((self.members[pairs] >= 0).all(1), axis=1)
        pairs = pairs[~both]
        joined = np.maximum(self.members[pairs[:, 0]], self.members[pairs[:, 1]])
        found = _cross(self.sightings, self.frames[pairs[:, 0]], joined)
        more = np.minimum((joined >= 0).sum(1) - 2, _FARTHER)
        costs = found.misfit.numpy() / (1 + config.patience * more)
        good = costs < config.same
        self.pairs = np.concatenate((self.pairs, pairs[good]))
        self.costs = np.concatenate((self.costs, costs[good]))


def _apart(sightings: Sightings, frames: Indices, members: Indices) -> Groups:
    """Groups without those that are where another of more views is: listed twice, or merged."""
    points = _cross(sightings, frames, members).points
    kept = np.ones(len(frames), bool)
    support = (members >= 0).sum(1)
    pairs = _pairs_within(frames)
    distance = (points[pairs[:, 0]] - points[pairs[:, 1]]).norm(dim=-1).nanmedian(-1).values
    for one, other in pairs[distance.numpy() < sightings.config.apart]:
        kept[one if support[one] < support[other] else other] = False
    return Groups(frames[kept], members[kept], points.numpy()[kept])


def _cross(sightings: Sightings, frames: Indices, members: Indices) -> Crossing:
    return sightings.cross(torch.from_numpy(frames), torch.from_numpy(members))


def _pairs_within(frames: Indices) -> Indices:
    """All pairs of rows that have the same frame, (M, 2), the first before the second."""
    count = len(frames)
    order = np.argsort(frames, kind="stable")
    starts = np.searchsorted(frames[order], frames[order])
    before = np.arange(count) - starts  # rows of the frame that come before each row
    second = np.repeat(np.arange(count), before)
    within = np.arange(before.sum()) - np.repeat(np.cumsum(before) - before, before)
    pairs = np.stack((np.repeat(starts, before) + within, second), 1)
    found: Indices = order[pairs]
    return found
