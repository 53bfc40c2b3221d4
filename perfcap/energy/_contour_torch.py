"""The contour energy in plain torch: differentiable, on any device, the oracle of the kernel."""

from __future__ import annotations

import torch
from torch import Tensor

_FAINT = 1e-12  # optical depth of pixels that show the background alone


def contour(depth: Tensor, slope: Tensor, edges: Tensor, flat: Tensor) -> Tensor:
    """Energy of each pixel, (H, W); arguments as of the kernel's ``contour``."""
    size, x, y = _direction(depth, slope)
    alike = edges[0] * (x * x - y * y) + 2 * edges[1] * x * y
    return torch.exp(-depth) * size * (flat - alike)


def curvature(depth: Tensor, slope: Tensor, edges: Tensor, flat: Tensor, bend: float) -> Tensor:
    """Entries xx, xy, yy of the curvature for a shift, over the optical depth, (3, H, W)."""
    size, x, y = _direction(depth, slope)
    strength = edges.square().sum(0).sqrt() + flat.abs()
    stiff = torch.exp(-depth) * size * bend * strength / depth.clamp(min=_FAINT)
    return torch.stack((stiff * x * x, stiff * x * y, stiff * y * y))


def _direction(depth: Tensor, slope: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Size of the slope, zero where there is no contour, and its direction."""
    squared = slope.square().sum(0)
    there = (depth >= _FAINT) & (squared >= 1e-24)
    size = torch.where(there, squared, 1.0).sqrt()
    x, y = slope[0] / size, slope[1] / size
    return torch.where(there, size, 0.0), x, y
