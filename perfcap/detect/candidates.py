"""Where else a joint may be: the second peak of its heat map, and those of its counterpart's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from perfcap.detect.heatmap import decode_dark

PEAKS = 2  # of each map
_REACH = 3  # map pixels about a peak that belong to it
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


def find_candidates(maps: Tensor, confidence: Tensor, mirrored: Sequence[int]) -> Candidates:
    """The highest peaks of each joint's map and of its counterpart's.

    Args:
        maps: heat maps (N, J, h, w).
        confidence: of the highest peaks, (N, J). Other places get as much less as they have less
            of the map's mass about them.
        mirrored: each joint's counterpart on the other side.

    Returns:
        ``2 PEAKS`` places a joint in pixels of the maps, the joint's own highest peak first.
    """
    own = _peaks(maps)
    places = torch.cat((own, own[:, list(mirrored)]), 2)
    height, width = maps.shape[-2:]
    column = places[..., 0].round().long().clamp(0, width - 1)
    row = places[..., 1].round().long().clamp(0, height - 1)
    mass = nn.functional.avg_pool2d(maps.clamp(min=0), _SUMMED, 1, _SUMMED // 2)
    found = mass.flatten(2).gather(2, row * width + column)
    share = found / found[..., :1].clamp(min=_TINY)
    return Candidates(places, (confidence[..., None] * share).nan_to_num(0.0).clamp(0, 1))


def merge_candidates(one: Candidates, other: Candidates, near: float) -> Candidates:
    """What two looks at the same crops show: means of places and supports.

    Args:
        one: pixels of the crops.
        other: of the same joints.
        near: places less far apart are one, pixels.

    Returns:
        As many a joint as one look has, the best supported, none near another.
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
    agreed = torch.where(apart < near, other.support[..., None, :], 0.0)
    second, index = agreed.max(-1)
    theirs = other.places.gather(2, index[..., None].expand(*index.shape, 2))
    weight = (second / (one.support + second).clamp(min=_TINY))[..., None]
    return Candidates(one.places + weight * (theirs - one.places), 0.5 * (one.support + second))


def _peaks(maps: Tensor) -> Tensor:
    """The highest pixels of maps that are not near each other, to fractions, (N, J, PEAKS, 2)."""
    height, width = maps.shape[-2:]
    rows = torch.arange(height, device=maps.device)[:, None]
    columns = torch.arange(width, device=maps.device)
    left, found = maps, []
    for _ in range(PEAKS):
        place, _ = decode_dark(left)
        found.append(place)
        index = left.flatten(2).argmax(-1)[..., None, None]
        far = (rows - index // width).abs().maximum((columns - index % width).abs()) > _REACH
        left = torch.where(far, left, left.amin((-2, -1), keepdim=True))
    return torch.stack(found, 2)
