"""Images of Gaussians in plain torch: differentiable, on any device, the oracle of the kernels."""

from __future__ import annotations

import torch
from torch import Tensor

_FAR = 1e9  # px from the image, where nothing is seen: squares of more overflow in float32 beyond


def draw(
    centre: Tensor, form: Tensor, thickness: Tensor, size: tuple[int, int], least: float
) -> tuple[Tensor, Tensor]:
    """Optical depth (B, H, W) of Gaussians (B, Q), and its descent (B, 2, H, W).

    Neither jumps at the rim of a Gaussian, where its optical depth has fallen to ``least``.
    One Gaussian of all images after the other, so that memory does not grow with their number.
    """
    depth = centre.new_zeros(len(centre), *size)
    slope = centre.new_zeros(len(centre), 2, *size)
    for q in range(thickness.shape[-1]):
        t, u, v = _values(centre[:, q], form[:, q], thickness[:, q], size, least)
        kept = torch.where(t > 0, t - least, 0.0)
        rest = torch.where(t > 0, least * (t.clamp(min=least) / least).log(), 0.0)
        depth = depth + kept - rest
        slope = slope + torch.stack((kept * u, kept * v), 1)
    return depth, slope


def gather(centre: Tensor, form: Tensor, thickness: Tensor, images: Tensor, least: float) -> Tensor:
    """Sums (B, Q, K) of images (B, K, H, W), weighed by the optical depth of each Gaussian."""
    size = (images.shape[-2], images.shape[-1])
    sums = [
        (_values(centre[:, q], form[:, q], thickness[:, q], size, least)[0][:, None] * images).sum(
            (-2, -1)
        )
        for q in range(thickness.shape[-1])
    ]
    return torch.stack(sums, 1)


def _values(
    centre: Tensor, form: Tensor, thickness: Tensor, size: tuple[int, int], least: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Optical depth (B, H, W) of one Gaussian, and minus the slope of its logarithm in x and y.

    What is no ellipse, or no number, has none.
    """
    xx, xy, yy = form.detach().unbind(-1)
    real = (xx > 0) & (xx * yy - xy * xy > 0) & (thickness.detach() > least)  # and numbers
    real = (real & (centre.detach().abs() < _FAR).all(-1))[:, None]
    centre = torch.where(real, centre, 0)
    form = torch.where(real, form, form.new_tensor([1.0, 0, 1]))
    thickness = torch.where(real[:, 0], thickness, 0)
    rows = torch.arange(size[0], dtype=centre.dtype, device=centre.device)
    columns = torch.arange(size[1], dtype=centre.dtype, device=centre.device)
    x, y = (part[:, None, None] for part in centre.unbind(-1))
    xx, xy, yy = (part[:, None, None] for part in form.unbind(-1))
    a = thickness[:, None, None]
    dx, dy = columns - x, rows[:, None] - y
    u, v = xx * dx + xy * dy, xy * dx + yy * dy
    squared = u * dx + v * dy
    far = 2 * (a.detach() / least).clamp(min=1).log()
    return torch.where(squared.detach() <= far, a * torch.exp(-0.5 * squared), 0.0), u, v
