"""Axes that follow the ray through a person, in which poses look alike all over the image."""

from __future__ import annotations

import torch
from torch import Tensor


def toward(plane: Tensor) -> Tensor:
    """The smallest rotation that turns the optical axis onto a ray.

    Args:
        plane: (..., 2), the ray's x/z and y/z in camera coordinates.

    Returns:
        (..., 3, 3); its transpose takes camera coordinates to axes whose z is the ray.
    """
    ray = torch.cat((plane, torch.ones_like(plane[..., :1])), -1)
    x, y, z = torch.nn.functional.normalize(ray, dim=-1).unbind(-1)
    # I + [v] + [v]^2 / (1 + z) with v = (0, 0, 1) x ray; z > 0, so it is never singular
    share = 1 / (1 + z)
    rows = (
        *(1 - share * x * x, -share * x * y, x),
        *(-share * x * y, 1 - share * y * y, y),
        *(-x, -y, z),
    )
    return torch.stack(rows, -1).reshape(*plane.shape[:-1], 3, 3)
