"""How much of each Gaussian does a pixel see? Visibility in an absorbing medium.

Along a ray the light that arrives from depth s is ``T(s) = exp(-tau(s))`` with the optical depth in
front of it. A Gaussian's visibility is the integral of T times its own density (Rhodin et al. 2015,
Eq. 3): what it absorbs. Those of all Gaussians and of the background add up to one.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.geometry.camera import NEAR, Camera

STEPS = 48  # intervals along a ray
_REACH = 3.5  # deviations of a Gaussian on either side of its middle
_FAINT = 1e-3  # optical depth of a Gaussian that a ray does not touch
_CHUNK = 1 << 22  # numbers at once


def visibilities(
    camera: Camera, points: Tensor, deviations: Tensor, densities: Tensor, pixels: Tensor
) -> tuple[Tensor, Tensor]:
    """What pixels see of Gaussians, and of what is behind them.

    Within an interval of the ray, the light it absorbs is shared out by optical depth.

    Args:
        camera: of one view at one time, batch (1,).
        points: centres in the world, (Q, 3) m.
        deviations: (Q,) m.
        densities: in the middle of each, (Q,) 1/m.
        pixels: (P, 2).

    Returns:
        Visibility of each Gaussian (P, Q) and of the background (P,): each row adds up to one.
    """
    local = camera.to_camera(points)[0]
    plane = camera.to_plane(pixels[None])[0]
    rays = torch.nn.functional.normalize(torch.nn.functional.pad(plane, (0, 1), value=1.0), dim=-1)
    chunk = max(1, _CHUNK // (len(points) * (STEPS + 1)))
    parts = [_seen(local, deviations, densities, some) for some in torch.split(rays, chunk)]
    return torch.cat([seen for seen, _ in parts]), torch.cat([left for _, left in parts])


def _seen(
    local: Tensor, deviations: Tensor, densities: Tensor, rays: Tensor
) -> tuple[Tensor, Tensor]:
    """Visibilities (P, Q), background (P,), of Gaussians (Q, 3) in camera axes on rays (P, 3)."""
    middle = rays @ local.mT  # P Q
    squared = (local.square().sum(-1) - middle.square()).clamp(min=0)
    thickness = math.sqrt(2 * math.pi) * deviations * densities
    thickness = thickness * torch.exp(-0.5 * squared / deviations.square())
    thickness = torch.where(middle > 2 * NEAR, thickness, 0.0)
    touched = thickness > _FAINT
    near = torch.where(touched, middle - _REACH * deviations, torch.inf).amin(-1)
    far = torch.where(touched, middle + _REACH * deviations, -torch.inf).amax(-1)
    empty = ~touched.any(-1)
    near, far = torch.where(empty, 0.0, near), torch.where(empty, 1.0, far)
    share = torch.linspace(0, 1, STEPS + 1, dtype=rays.dtype, device=rays.device)
    depth = near[:, None] + (far - near)[:, None] * share  # P K
    place = (depth[:, :, None] - middle[:, None]) / deviations  # P K Q
    passed = thickness[:, None] * torch.special.ndtr(place)
    # tails beyond the ends belong to the first and the last interval
    passed = torch.cat((0 * passed[:, :1], passed[:, 1:-1], thickness[:, None]), 1)
    each = passed.diff(dim=1)  # P K-1 Q
    light = torch.exp(-passed.sum(-1))  # P K
    lost = -light.diff(dim=1)
    whole = each.sum(-1).clamp(min=1e-12)
    seen = ((lost / whole)[..., None] * each).sum(1)
    return seen, light[:, -1]
