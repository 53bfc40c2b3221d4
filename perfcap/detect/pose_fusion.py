"""One 3D pose of two: a lifter's, which knows motion, and a network's, which sees the image."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.geometry.alignment import procrustes

# Chosen on videos of rendered people (``experiments/pose_fusion.py``).
SHARE = 0.35  # of the other pose, where both agree
APART = 0.15  # m, mean distance of two poses from which one of them is wrong
# Errors of captures are as these products in the mean (``experiments/trust_video.py``).
_ALONE = (1.61, 6.15)  # power of the lifter's own error, and a factor
_TOGETHER = (1.276, 0.505, 8.1)  # powers of that error and of the distance, and a factor
_LEAST = 0.01  # m


def fuse_poses(
    lifted: Detections, seen: Detections | None, share: float = SHARE, apart: float = APART
) -> Detections:
    """Lifted 3D poses, nearer to those that a network saw, where both mean the same.

    The network's poses are brought to the size of the lifted ones (one factor a view) and, frame
    by frame, to their heading: a network of crops knows neither well. Then each joint moves a share
    of the way; less the farther apart the poses are, since then one of them is wrong. How far they
    are apart also tells how far the result may be off, with what the lifter says of itself.

    Args:
        lifted: with 3D poses, (F, C, 16).
        seen: the same frames and views, with 3D poses or without; None if there are none.
        share: of the way, where both mean the same.
        apart: mean distance of two poses at which half of it is left, metres.
    """
    if lifted.joints3d is None:
        return lifted
    if seen is None or seen.joints3d is None:
        known = _expected(lifted.deviation3d, None)
        return lifted if known is None else replace(lifted, deviation3d=known)
    both = lifted.trusted3d & seen.trusted3d
    other = _sized(seen.joints3d.to(lifted.joints3d), lifted.joints3d, both)
    turned = procrustes(other, lifted.joints3d, scale=False).apply(other)
    distance = (turned - lifted.joints3d).norm(dim=-1).mean(-1)
    part = torch.where(both, share / (1 + (distance / apart) ** 6), 0)[..., None, None]
    return replace(
        lifted,
        joints3d=lifted.joints3d + part * (turned - lifted.joints3d),
        deviation3d=_expected(lifted.deviation3d, torch.where(both, distance, torch.nan)),
    )


def _expected(spread: Tensor | None, distance: Tensor | None) -> Tensor | None:
    """Error (F, C) to expect, metres, of what a lifter says and how far another pose is."""
    if spread is None:
        return None
    power, constant = _ALONE
    alone = constant * spread.clamp(min=_LEAST) ** power
    if distance is None:
        return alone
    power, share, constant = _TOGETHER
    together = constant * spread.clamp(min=_LEAST) ** power * (distance + _LEAST) ** share
    return torch.where(distance.isfinite(), together, alone)


def _sized(poses: Tensor, like: Tensor, both: Tensor) -> Tensor:
    """Poses (F, C, 16, 3) scaled by one factor a view to the size of others, in frames of both."""
    known = both[..., None].expand(poses.shape[:-1])
    theirs, ours = (
        torch.where(known, each.norm(dim=-1), torch.nan).transpose(0, 1).flatten(1).nanmedian(-1)
        for each in (poses, like)
    )
    factor = (ours.values / theirs.values.clamp(min=1e-6)).nan_to_num(1.0)
    return poses * factor[:, None, None]
