"""Where else a joint may be: the second peak of its heat map, and those of its counterpart's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from perfcap.detect.heatmap import argmax2d

_REACH = 2  # map pixels about a peak that belong to it
_SUMMED = 3  # map pixels along the square about a place that speak for it
_TINY = 1e-12


@dataclass(frozen=True)
class Candidates:
    """Places where joints may be.

    Attributes:
        places: pixels, (N, J, C, 2).
        support: how likely the joint is there, by its own heat map, 0 to 1, (N, J, C).
    """

    places: Tensor
    support: Tensor

    def take(self, joints: Sequence[int]) -> Candidates:
        """Those of joints in another order."""
        return Candidates(self.places[:, joints], self.support[:, joints])


def find_candidates(
    maps: Tensor, points: Tensor, confidence: Tensor, mirrored: Sequence[int]
) -> Candidates:
    """The two highest peaks of each joint's map and of its counterpart's.

    Args:
        maps: heat maps (N, J, h, w), of probabilities or in proportion to them.
        points: the highest peaks, map pixels, (N, J, 2).
        confidence: of these, (N, J). Other places get as much less as they have less of the map's
            mass about them.
        mirrored: each joint's counterpart on the other side.

    Returns:
        Four places a joint in pixels of the maps: its own peak, the second, and those of the
        other side.
    """
    own = torch.stack((points, _second_peak(maps, points)), 2)
    places = torch.cat((own, own[:, list(mirrored)]), 2)
    height, width = maps.shape[-2:]
    whole = places.nan_to_num(0.0).round().long()
    column, row = whole[..., 0].clamp(0, width - 1), whole[..., 1].clamp(0, height - 1)
    found = _mass(maps, row, column)
    share = found / found[..., :1].clamp(min=_TINY)
    support = (confidence[..., None] * share).nan_to_num(0.0).clamp(0, 1)
    support[..., 0] = confidence
    return Candidates(places, support)


def join_candidates(parts: Sequence[Candidates | None]) -> Candidates | None:
    """Those of several crops or frames as one, along the first axis; None where some have none."""
    found = [part for part in parts if part is not None]
    if not found or len(found) < len(parts):
        return None
    places = torch.cat([part.places for part in found])
    return Candidates(places, torch.cat([part.support for part in found]))


def merge_candidates(one: Candidates, other: Candidates, near: float) -> Candidates:
    """What two looks at the same crops show: means of places and supports.

    Args:
        one: pixels of the crops.
        other: of the same joints.
        near: places less far apart are one, pixels.

    Returns:
        As many a joint as one look has, the best supported first. Where fewer differ, the rest
        have no support.
    """
    parts = [_seconded(one, other, near), _seconded(other, one, near)]
    places = torch.cat([part.places for part in parts], 2)
    support = torch.cat([part.support for part in parts], 2)
    kept_places, kept_support = [], []
    left = support.clone()
    for _ in range(one.support.shape[-1]):
        best = left.argmax(-1, keepdim=True)
        place = places.gather(2, best[..., None].expand(*best.shape, 2))
        kept_places.append(place)
        kept_support.append(left.gather(2, best).clamp(min=0))
        left = left.masked_fill((places - place).norm(dim=-1) < near, -1.0)
    return Candidates(torch.cat(kept_places, 2), torch.cat(kept_support, 2))


def _seconded(one: Candidates, other: Candidates, near: float) -> Candidates:
    """The candidates of one look, with what another says of the same places."""
    apart = (one.places[..., :, None, :] - other.places[..., None, :, :]).norm(dim=-1)
    nearest, index = apart.min(-1)
    second = torch.where(nearest < near, other.support.gather(2, index), 0.0)
    theirs = other.places.gather(2, index[..., None].expand(*index.shape, 2))
    weight = (second / (one.support + second).clamp(min=_TINY))[..., None]
    return Candidates(one.places + weight * (theirs - one.places), 0.5 * (one.support + second))


def _second_peak(maps: Tensor, points: Tensor) -> Tensor:
    """The highest pixel that is a peak and not near the first, (N, J, 2); the first if none is."""
    height, width = maps.shape[-2:]
    rows = torch.arange(height, device=maps.device)[:, None]
    columns = torch.arange(width, device=maps.device)
    first = points[..., None, None, :]
    far = (rows - first[..., 1]).abs().maximum((columns - first[..., 0]).abs()) > _REACH
    peak = far & (maps >= _highest_around(maps))
    second, _ = argmax2d(torch.where(peak, maps, -torch.inf))
    return torch.where(peak.any(-1).any(-1)[..., None], second, points)


def _highest_around(maps: Tensor) -> Tensor:
    """The largest of each pixel and its eight neighbours, (N, J, h, w); no pooling is as fast."""
    wide = nn.functional.pad(maps, (1, 1, 1, 1), value=-torch.inf)
    rows = wide[..., :-2].maximum(wide[..., 1:-1]).maximum(wide[..., 2:])
    return rows[..., :-2, :].maximum(rows[..., 1:-1, :]).maximum(rows[..., 2:, :])


def _mass(maps: Tensor, row: Tensor, column: Tensor) -> Tensor:
    """Mean of what is not negative in the square about some pixels, (N, J, C), black outside."""
    reach = _SUMMED // 2
    wide = nn.functional.pad(maps.clamp(min=0), (reach,) * 4)
    width, total = wide.shape[-1], torch.zeros_like(row, dtype=maps.dtype)
    for down in range(_SUMMED):
        for across in range(_SUMMED):
            index = (row + down) * width + column + across
            total = total + wide.flatten(2).gather(2, index)
    return total / _SUMMED**2
