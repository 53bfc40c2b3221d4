"""2D joint tracks as a lifter sees them: in axes that follow the person, at the person's scale.

Where in the image a person stands, and how large, says little about the pose. Rays are turned so
that the person is straight ahead and divided by the person's extent; how large that extent is
stays as one number, since perspective depends on it.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool1d

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.viewing_ray import toward

FEATURES = 3 * len(LANDMARKS) + 1
"""Numbers a frame: x, y and confidence of 16 landmarks, and the logarithm of the extent."""

_CENTER_REACH = 7  # frames either side over which the middle is averaged
_EXTENT_REACH = 20  # and the extent
_FARTHEST = 5.0  # extents from the middle: farther is an outlier, and a large number
_BEHIND = 0.1  # least cosine-like depth of a turned ray
_TINY = 1e-6
_USUAL_EXTENT = 0.15  # tangent of the angle that joints deviate from the middle, at 3 m


def lifting_features(plane: Tensor, confidence: Tensor) -> tuple[Tensor, Tensor]:
    """What a lifter is given for a track, and how to turn its answer.

    Args:
        plane: undistorted x/z and y/z of the landmarks, (*b, F, 16, 2).
        confidence: (*b, F, 16); 0 where unseen.

    Returns:
        Features (*b, F, 49), and rotations (*b, F, 3, 3) that take vectors in the axes of the
        answer to camera axes.
    """
    seen = (confidence > 0) & plane.isfinite().all(-1)
    weight = torch.where(seen, confidence, 0.0)
    plane = torch.where(seen[..., None], plane, 0.0)
    center = _windowed(plane, weight, _CENTER_REACH)
    turn = toward(center)
    rays = torch.cat((plane, torch.ones_like(plane[..., :1])), -1) @ turn
    local = rays[..., :2] / rays[..., 2:].clamp(min=_BEHIND)
    square = local.square().sum(-1, keepdim=True)
    extent = _windowed(square, weight, _EXTENT_REACH).clamp(min=_TINY**2).sqrt()
    extent = torch.where(extent > _TINY, extent, _USUAL_EXTENT)
    scaled = (local / extent[..., None]).clamp(-_FARTHEST, _FARTHEST)
    scaled = torch.where(seen[..., None], scaled, 0.0)
    return torch.cat((scaled.flatten(-2), weight, extent.log()), -1), turn


def _windowed(values: Tensor, weight: Tensor, reach: int) -> Tensor:
    """Weighted mean over joints and frames nearby, (*b, F, k) of (*b, F, 16, k).

    Frames without any weight nearby take the mean of the track; a track without any, zero.
    """
    total = weight.sum(-1, keepdim=True)
    moment = (values * weight[..., None]).sum(-2)
    near = _sliding(total, reach)
    mean = _sliding(moment, reach) / near.clamp(min=_TINY)
    overall = moment.mean(-2, keepdim=True) / total.mean(-2, keepdim=True).clamp(min=_TINY)
    return torch.where(near > _TINY, mean, overall)


def _sliding(values: Tensor, reach: int) -> Tensor:
    """Mean over frames up to ``reach`` away, frames outside counting as zeros; (*b, F, k)."""
    lead = values.shape[:-2]
    flat = values.reshape(-1, *values.shape[-2:]).transpose(1, 2)
    pooled = avg_pool1d(flat, 2 * reach + 1, stride=1, padding=reach)
    return pooled.transpose(1, 2).reshape(*lead, *values.shape[-2:])
