"""Limbs that a detector gave to the wrong one of two people."""

from __future__ import annotations

from itertools import combinations

import torch
from torch import Tensor

from perfcap.detect.association.settle import Settled, expected
from perfcap.detect.association.sightings import Sightings
from perfcap.detect.joint_set import LANDMARKS

_LIMBS = [
    [LANDMARKS.index(f"{side}_{joint}") for joint in joints]
    for side in "lr"
    for joints in (("shoulder", "elbow", "wrist"), ("elbow", "wrist"), ("wrist",),
                   ("hip", "knee", "ankle", "toe"), ("knee", "ankle", "toe"), ("ankle", "toe"))
]  # fmt: skip


def own_limbs(sightings: Sightings, settled: Settled, rate: float) -> Tensor:
    """The slot that holds each joint of each person, (K, F, C, J); -1 for none.

    Where two people are in a view, an arm or a leg of one may be listed as the other's, of both or
    of one of them. What fits where they are in the frames around is put back; a limb that is a
    second copy of the other's is dropped.
    """
    config = sightings.config
    points = expected(settled.points, rate, sightings)
    owner = settled.slots[..., None].repeat(1, 1, 1, len(LANDMARKS))
    frames = torch.arange(points.shape[1])
    rays = [sightings.rays(frames, slots) for slots in settled.slots]
    for one, other in combinations(range(len(points)), 2):
        pair = (one, other)
        off = {
            (a, b): _off(sightings, points[a], *rays[b]) for a in pair for b in pair
        }  # of person a from the slot of b
        for limb in _LIMBS:
            mean = {key: value[..., limb].mean(-1) for key, value in off.items()}
            straight = mean[one, one] + mean[other, other]
            crossed = mean[one, other] + mean[other, one]
            back = crossed + config.clearer < straight  # false for NaN: unknown
            owner[one][..., limb] = _put(owner[one][..., limb], settled.slots[other], back)
            owner[other][..., limb] = _put(owner[other][..., limb], settled.slots[one], back)
            for a, b in (pair, pair[::-1]):
                copied = ~back & (mean[b, a] + config.clearer < mean[a, a])
                copied &= mean[b, b] < config.same
                owner[a][..., limb] = _put(owner[a][..., limb], torch.tensor(-1), copied)
    return owner


def _put(slots: Tensor, others: Tensor, where: Tensor) -> Tensor:
    """Slots (F, C, L), and those of somebody else (F, C) where that is so."""
    return torch.where(where[..., None], others[..., None], slots)


def _off(sightings: Sightings, points: Tensor, plane: Tensor, weights: Tensor) -> Tensor:
    """Distances of joints (F, J, 3) from rays (F, C, J, 2), saturated; NaN where not known."""
    off = sightings.distances(torch.arange(len(points)), points, plane)
    return torch.where(weights > 0, off.clamp(max=sightings.config.saturated), torch.nan)
