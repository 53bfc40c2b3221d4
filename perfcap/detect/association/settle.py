"""Who each detection belongs to, given where everybody is before and after."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from perfcap.detect.association.sightings import Sightings
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16

_ARMS = [i for i, name in enumerate(LANDMARKS) if name[2:] in ("shoulder", "elbow", "wrist")]
_LEGS = [i for i, name in enumerate(LANDMARKS) if name[2:] in ("hip", "knee", "ankle", "toe")]
_MIDDLE = [i for i in range(len(LANDMARKS)) if i not in _ARMS + _LEGS]
_LIMBS = [
    [LANDMARKS.index(f"{side}_{joint}") for joint in joints]
    for side in "lr"
    for joints in (("shoulder", "elbow", "wrist"), ("elbow", "wrist"), ("wrist",),
                   ("hip", "knee", "ankle", "toe"), ("knee", "ankle", "toe"), ("ankle", "toe"))
]  # fmt: skip
_OTHER_SIDE = list(LANDMARKS16.mirrored())
_ROUNDS = 2
_WEIGHING = 3  # rounds of robust weights
_STRANGE = 0.5  # of the saturated distance: nobody's detection


@dataclass(frozen=True)
class Settled:
    """Who is who.

    Attributes:
        slots: of each person's detections, -1 where a view does not show them, (K, F, C).
        points: joints, (K, F, J, 3) m, NaN where unknown.
        misfit: mean distance of the joints from the rays of a person's detection, m, (K, F, C);
            NaN where there is none.
        margin: how much farther the next detection of the view would be, m, (K, F, C); infinite
            where there is no other.
    """

    slots: Tensor
    points: Tensor
    misfit: Tensor
    margin: Tensor


def settle(sightings: Sightings, points: Tensor, rate: float) -> Settled:
    """Give every detection to who is there, by where people are in the frames around.

    Args:
        sightings: all detections.
        points: joints of K people as a first guess, (K, F, J, 3), NaN where unknown.
        rate: frames a second.
    """
    for _ in range(_ROUNDS):
        costs = _costs(sightings, expected(points, rate, sightings))
        slots = _assign(costs, _STRANGE * sightings.config.saturated)
        points = torch.stack([_cross(sightings, person) for person in slots])
    chosen = costs.gather(-1, slots.clamp(min=0)[..., None])[..., 0]
    there = slots >= 0
    others = costs.scatter(-1, slots.clamp(min=0)[..., None], torch.inf)
    margin = torch.where(there, others.amin(-1) - chosen, torch.inf)
    return Settled(slots, points, torch.where(there, chosen, torch.nan), margin)


def expected(points: Tensor, rate: float, sightings: Sightings) -> Tensor:
    """Joints (K, F, J, 3) as the frames around have them; short gaps are bridged.

    A mean in time with robust weights that starts at the median: mistakes of a few frames do not
    count.
    """
    config = sightings.config
    known = points.isfinite().all(-1)
    filled = _bridged(points, known, max(1, round(config.memory * rate)))
    reach = max(1, math.ceil(2 * config.smooth * rate))
    steps = range(-reach, reach + 1)
    around = torch.stack([_shifted(filled, step) for step in steps])
    time = torch.tensor([math.exp(-0.5 * (s / (config.smooth * rate)) ** 2) for s in steps])
    weights = time.to(points).reshape(-1, 1, 1, 1) * around.isfinite().all(-1)
    mean = around.nanmedian(0).values.nan_to_num(nan=0)
    around = around.nan_to_num(nan=0)
    for _ in range(_WEIGHING):
        off = (around - mean).norm(dim=-1) / (2 * config.robust)
        robust = weights / (1 + off.square())
        mean = (robust[..., None] * around).sum(0) / robust.sum(0).clamp(min=1e-9)[..., None]
    return torch.where((weights.sum(0) > 0)[..., None], mean, torch.nan)


def _shifted(values: Tensor, step: int) -> Tensor:
    """Values (K, F, ...) of later frames; NaN behind the ends."""
    moved = torch.full_like(values, torch.nan)
    frames = values.shape[1]
    if abs(step) < frames:
        moved[:, max(0, -step) : frames - max(0, step)] = values[
            :, max(0, step) : frames - max(0, -step)
        ]
    return moved


def _bridged(points: Tensor, known: Tensor, longest: int) -> Tensor:
    """Unknown joints between two known ones at most ``longest`` frames apart, on a line."""
    frames = torch.arange(points.shape[1])[:, None]
    last = torch.where(known, frames, -1).cummax(1).values
    after = torch.where(known, frames, points.shape[1]).flip(1).cummin(1).values.flip(1)
    inside = (last >= 0) & (after < points.shape[1]) & (after - last <= longest)
    start, end = last.clamp(min=0), after.clamp(max=points.shape[1] - 1)

    def at(index: Tensor) -> Tensor:
        return points.gather(1, index[..., None].expand(*index.shape, 3))

    share = (frames - start) / (end - start).clamp(min=1)
    between = torch.lerp(at(start), at(end), share[..., None].to(points))
    filled = torch.where(inside[..., None], between, torch.nan)
    return torch.where(known[..., None], points, filled)


def _costs(sightings: Sightings, points: Tensor) -> Tensor:
    """Mean distance of people from rays, m, (K, F, C, P); infinite where nothing is compared.

    Detectors exchange left and right of a person; arms and legs are taken as they fit better.
    """
    config = sightings.config
    costs = []
    for person in points:
        straight, count, weight = _off(sightings, person)
        mirrored, _, _ = _off(sightings, person[:, _OTHER_SIDE])
        best = straight[..., _MIDDLE].sum(-1)
        for pair in (_ARMS, _LEGS):
            turned = mirrored[..., pair].sum(-1) + config.mirrored * weight[..., pair].sum(-1)
            best = best + straight[..., pair].sum(-1).minimum(turned)
        mean = best / weight.sum(-1).clamp(min=1e-9)
        costs.append(torch.where(count >= config.least_joints, mean, torch.inf))
    return torch.stack(costs)


def _off(sightings: Sightings, points: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Weighted distances of joints (F, J, 3) from rays, (F, C, P, J), their number and weights."""
    off = sightings.distances(torch.arange(len(points)), points, sightings.plane)
    counted = (sightings.weights > 0) & ~off.isnan()
    weight = sightings.weights * counted
    clamped = off.nan_to_num(nan=0).clamp(max=sightings.config.saturated)
    return weight * clamped, counted.sum(-1), weight


def _assign(costs: Tensor, strange: float) -> Tensor:
    """Slots (K, F, C) that cost least in all, one a person; none that costs as much as strangers'.

    Args:
        costs: (K, F, C, P).
        strange: what it costs to have no detection.
    """
    slots = torch.full(costs.shape[:3], -1)
    near = costs < strange
    open_ = near.any(-1).any(0).nonzero().tolist()
    bounded, found = costs.clamp(max=strange).numpy(), slots.numpy()
    for frame, view in open_:
        table = bounded[:, frame, view]
        for person, slot in zip(*linear_sum_assignment(table), strict=True):
            if table[person, slot] < strange:
                found[person, frame, view] = slot
    return torch.from_numpy(np.ascontiguousarray(found))


def _cross(sightings: Sightings, slots: Tensor) -> Tensor:
    """Joints (F, J, 3) of one person's slots (F, C); no person where two views see nobody."""
    found = sightings.cross(torch.arange(len(slots)), slots)
    fits = found.misfit < sightings.config.saturated
    return torch.where(fits[:, None, None], found.points, torch.nan)


# --- Limbs that a detector gave to the wrong one of two people ------------------------------------


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
            (a, b): _ray_distances(sightings, points[a], *rays[b]) for a in pair for b in pair
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


def _ray_distances(sightings: Sightings, points: Tensor, plane: Tensor, weights: Tensor) -> Tensor:
    """Distances of joints (F, J, 3) from rays (F, C, J, 2), saturated; NaN where not known."""
    off = sightings.distances(torch.arange(len(points)), points, plane)
    return torch.where(weights > 0, off.clamp(max=sightings.config.saturated), torch.nan)
