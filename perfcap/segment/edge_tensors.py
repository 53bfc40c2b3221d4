"""Edges of images as tensors: the twin of ``edge_field`` that gradients go through.

For networks that look at images beside or in place of derivatives, and learn from what a solve
makes of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from perfcap.errors import InputError
from perfcap.segment.edge_field import EdgeSettings

_TAPS = 4.0  # deviations of the blur on either side


@dataclass(frozen=True)
class TensorField:
    """What a contour gains or pays in each pixel of a part of an image, as tensors.

    Attributes:
        edges: cosine and sine of twice the direction of the gradient, times its strength,
            (2, h, w).
        flat: price of a unit of contour, (h, w).
        corner: row and column of the first pixel in the image.
    """

    edges: Tensor
    flat: Tensor
    corner: tuple[int, int]

    @classmethod
    def of(cls, numbers: Tensor, corner: tuple[int, int] = (0, 0)) -> TensorField:
        """Of edges and price in one, (3, h, w)."""
        return cls(numbers[:2], numbers[2], corner)


def edge_tensors(image: Tensor, settings: EdgeSettings | None = None) -> Tensor:
    """Edges in two numbers and price of the pixels of images; differentiable in these.

    Args:
        image: RGB from 0 to 1, (*b, 3, h, w), of at least as many pixels as the blur reaches.
        settings: how; of ``find_edges``, whose results these are but for rounding.

    Returns:
        (*b, 3, h, w): two numbers of edges, and the price.

    Raises:
        InputError: another number of channels, or too small an image.
    """
    settings = settings or EdgeSettings()
    taps = round(2 * _TAPS * settings.blur + 1) | 1
    if image.ndim < 3 or image.shape[-3] != 3 or min(image.shape[-2:]) <= taps // 2 + 1:
        raise InputError(
            f"image has shape {tuple(image.shape)}; expected RGB from 0 to 1, (*b, 3, h, w), of "
            f"more than {taps // 2 + 1} pixels a side for a blur of {settings.blur:g}"
        )
    lead = image.shape[:-3]
    each = image.reshape(-1, 1, *image.shape[-2:])
    away = torch.arange(taps).to(image) - taps // 2
    bell = torch.exp(-0.5 * (away / settings.blur).square())
    smooth = _along(_along(each, bell / bell.sum(), -1), bell / bell.sum(), -2)
    rise, mean = image.new_tensor([-0.5, 0.0, 0.5]), image.new_tensor([0.25, 0.5, 0.25])
    gx, gy = _along(_along(smooth, rise, -1), mean, -2), _along(_along(smooth, rise, -2), mean, -1)
    # of the structure tensor: channels that see an edge with opposite signs do not cancel
    cosine, sine = (gx * gx - gy * gy), 2 * gx * gy
    cosine, sine = (part.view(-1, 3, *image.shape[-2:]).sum(1) for part in (cosine, sine))
    squared = (cosine * cosine + sine * sine).clamp(min=1e-24).sqrt()
    strength = (3 * squared).sqrt().clamp(max=settings.clamp)
    share = strength / squared
    flat = (settings.low - strength).clamp(min=0)
    return torch.stack((cosine * share, sine * share, flat), 1).view(*lead, 3, *image.shape[-2:])


def _along(images: Tensor, filter_: Tensor, axis: int) -> Tensor:
    """Images (N, 1, h, w) filtered along rows or columns, mirrored at the border."""
    half = len(filter_) // 2
    pad = (half, half, 0, 0) if axis == -1 else (0, 0, half, half)
    shape = (1, 1, 1, -1) if axis == -1 else (1, 1, -1, 1)
    padded = functional.pad(images, pad, mode="reflect")
    return functional.conv2d(padded, filter_.view(shape))
