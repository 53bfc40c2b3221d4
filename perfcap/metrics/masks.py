"""Overlap of silhouettes, and agreement of their outlines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from perfcap.errors import InputError
from perfcap.setting_checks import require_count

BOUNDARY_SHARE = 0.008  # of the image's diagonal, Perazzi et al. 2016


@dataclass(frozen=True)
class MaskOverlap:
    """How well one mask covers the truth, each from 0 to 1.

    Attributes:
        iou: intersection over union.
        precision: share of the mask that is true.
        recall: share of the truth that is in the mask.
    """

    iou: float
    precision: float
    recall: float


@dataclass(frozen=True)
class SilhouetteScores:
    """How well masks cover the truth, each (*b), from 0 to 1.

    Attributes:
        iou: intersection over union.
        precision: share of the mask that is true.
        recall: share of the truth that is in the mask.
        boundary_f: harmonic mean of the shares of outline pixels that lie near the other outline.
    """

    iou: Tensor
    precision: Tensor
    recall: Tensor
    boundary_f: Tensor


def mask_overlap(mask: NDArray[np.bool_], truth: NDArray[np.bool_]) -> MaskOverlap:
    """Compare a mask (H, W) with the truth; what is empty on both sides agrees.

    Raises:
        InputError: the shapes differ, there are more axes, or they are not bool.
    """
    if mask.ndim != 2:
        raise InputError(
            f"mask has shape {mask.shape}, expected (H, W); silhouette_scores compares many at once"
        )
    shares = overlap(torch.tensor(mask), torch.tensor(truth))
    return MaskOverlap(*(float(share) for share in shares))


def silhouette_scores(mask: Tensor, truth: Tensor, radius: int | None = None) -> SilhouetteScores:
    """Compare masks (*b, H, W) with the truth; what is empty on both sides agrees.

    Args:
        mask: bool.
        truth: bool.
        radius: how far apart outlines may be, px; 0.8 % of the image's diagonal if not given.

    Raises:
        InputError: the shapes differ.
    """
    return SilhouetteScores(*overlap(mask, truth), boundary_f(mask, truth, radius))


def overlap(mask: Tensor, truth: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Intersection over union, precision and recall, (*b), in float64."""
    _check(mask, truth)
    both, found, real = (m.sum((-2, -1)).double() for m in (mask & truth, mask, truth))
    empty = (found + real == 0).double()

    def share(of: Tensor) -> Tensor:
        return torch.where(of > 0, both / of.clamp(min=1), empty)

    return share(found + real - both), share(found), share(real)


def boundary_f(mask: Tensor, truth: Tensor, radius: int | None = None) -> Tensor:
    """F measure of outlines (Perazzi et al. 2016, Sec. 5.1), (*b), from 0 to 1, float64.

    Outline pixels are those of a mask with a neighbour outside of it; the image's border is no
    outline. One is correct if a pixel of the other outline lies within a disk around it.

    Args:
        mask: (*b, H, W), bool.
        truth: (*b, H, W), bool.
        radius: of the disk, px; 0.8 % of the image's diagonal, rounded up, if not given.

    Raises:
        InputError: the shapes differ, masks are not bool or have no pixel, or no such radius.
    """
    _check(mask, truth)
    if radius is not None:
        require_count(radius, "radius", least=0)
    height, width = mask.shape[-2:]
    reach = int(np.ceil(BOUNDARY_SHARE * np.hypot(height, width))) if radius is None else radius
    lines = [outline(m.reshape(-1, 1, height, width)) for m in (mask, truth)]
    precision = _share_near(lines[0], lines[1], reach)
    recall = _share_near(lines[1], lines[0], reach)
    total = precision + recall
    score = torch.where(total > 0, 2 * precision * recall / total.clamp(min=1e-12), 0.0)
    return score.reshape(mask.shape[:-2])


def outline(mask: Tensor) -> Tensor:
    """Pixels of masks (N, 1, H, W) with one of their four neighbours outside of the mask."""
    framed = functional.pad(mask.float(), (1, 1, 1, 1), mode="replicate")
    neighbours = (
        framed[..., 1:-1, 2:],
        framed[..., 1:-1, :-2],
        framed[..., 2:, 1:-1],
        framed[..., :-2, 1:-1],
    )
    return mask & (torch.stack(neighbours).amin(0) < 0.5)


def _share_near(line: Tensor, other: Tensor, radius: int) -> Tensor:
    """Share (N,) of a line's pixels within a radius of the other line."""
    # one row of the disk at a time: a pixel is near if it is within reach in any of them
    near = torch.zeros_like(other, dtype=torch.bool)
    rows = other.shape[-2]
    wide = functional.pad(other.float(), (radius, radius, radius, radius))
    for shift in range(-radius, radius + 1):
        reach = int((radius**2 - shift**2) ** 0.5)
        row = wide[..., radius + shift : radius + shift + rows, radius - reach :]
        row = row[..., : other.shape[-1] + 2 * reach]
        near |= functional.max_pool2d(row, (1, 2 * reach + 1), stride=1) > 0.5
    hit = (line & near).sum((-3, -2, -1)).double()
    count, others = (m.sum((-3, -2, -1)) for m in (line, other))
    return torch.where(count > 0, hit / count.clamp(min=1), (others == 0).double())


def _check(mask: Tensor, truth: Tensor) -> None:
    if mask.shape != truth.shape or mask.dim() < 2 or 0 in mask.shape[-2:]:
        raise InputError(
            f"mask has shape {tuple(mask.shape)} and truth {tuple(truth.shape)}; give masks of one "
            "size, (*b, H, W)"
        )
    if mask.dtype != torch.bool or truth.dtype != torch.bool:
        raise InputError(
            f"mask is {mask.dtype} and truth {truth.dtype}, expected bool; compare labels first"
        )
