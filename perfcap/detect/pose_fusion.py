"""One pose of several: networks' joints in 2D, and in 3D a lifter's pose and a network's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.alignment import procrustes

# --- Several networks' joints of one person as one set of landmarks -------------------------------

_NEAR = 0.03  # of the person's size: two networks mean the same place
# Of other networks' confidence: on photographs the shipped ones promise 90 % and find 60. Chosen
# on 30 photographs: 57.5, 70.4 and 71.3 % of the joints are found with 1, 0.6 and 0.4, and 86.6,
# 86.9 and 84.6 % in the rendered sequence dev_skirt.
TRUST = 0.6
_MARKS, _FEWEST, _ALWAYS = 8, 10, 0.9  # landmarks of a frame, frames, and share of them


@dataclass(frozen=True)
class Landmarks:
    """The 16 landmarks of F frames as one network sees them.

    Attributes:
        joints2d: (F, 16, 2), pixels.
        confidence: (F, 16), 0 where unseen.
    """

    joints2d: Tensor
    confidence: Tensor


def fuse(first: Landmarks, others: Sequence[Landmarks], size: Tensor) -> Landmarks:
    """The first network's landmarks, improved and completed by others.

    Confidences are probabilities; those of other networks than the first count 0.6 times. Where a
    network sees a landmark within 3 % of the person's size of where it is known so far, the place
    is the mean by confidence. Elsewhere the surer one is taken.
    Left and right of the first network are believed: another's are exchanged in frames
    where that brings it nearer.

    Args:
        first: the network that followed the person.
        others: in the order in which they are asked.
        size: of the person, pixels, (F,).
    """
    for other in others:
        first = _joined(first, _sided(other, first, size), size)
    return first


def exchanged(other: Landmarks, first: Landmarks, size: Tensor) -> Tensor:
    """Frames in which a network's left and right are the other way round, (F,)."""
    order = list(LANDMARKS16.mirrored())
    both = (other.confidence > 0) & (first.confidence > 0)
    swapped = (other.confidence[:, order] > 0) & (first.confidence > 0)
    both = both & swapped
    straight = _distance(other.joints2d, first, size)
    across = _distance(other.joints2d[:, order], first, size)
    return torch.where(both, straight - across, 0.0).sum(-1) > 0


def sides_differ(other: Landmarks, first: Landmarks, size: Tensor) -> bool:
    """Whether that is so in nearly all frames: networks that err do in a third of them at most."""
    known = ((other.confidence > 0) & (first.confidence > 0)).sum(-1) >= _MARKS
    wrong = exchanged(other, first, size)[known]
    return len(wrong) >= _FEWEST and float(wrong.double().mean()) > _ALWAYS


def _distance(points: Tensor, first: Landmarks, size: Tensor) -> Tensor:
    """In sizes of the person, each landmark counting so much at most, (F, 16)."""
    far: Tensor = (points - first.joints2d).norm(dim=-1) / size[:, None]
    return far.clamp(max=0.2) * first.confidence


def _sided(other: Landmarks, first: Landmarks, size: Tensor) -> Landmarks:
    order = list(LANDMARKS16.mirrored())
    wrong = exchanged(other, first, size)
    return Landmarks(
        torch.where(wrong[:, None, None], other.joints2d[:, order], other.joints2d),
        TRUST * torch.where(wrong[:, None], other.confidence[:, order], other.confidence),
    )


def _joined(first: Landmarks, other: Landmarks, size: Tensor) -> Landmarks:
    near = (other.joints2d - first.joints2d).norm(dim=-1) < _NEAR * size[:, None]
    near = near & (first.confidence > 0) & (other.confidence > 0)
    share = other.confidence / (first.confidence + other.confidence).clamp(min=1e-9)
    surer = (other.confidence > first.confidence).to(share)
    weight = torch.where(near, share, surer)[..., None]
    points = first.joints2d + weight * (other.joints2d - first.joints2d)
    return Landmarks(points, torch.maximum(first.confidence, other.confidence))


# --------------------------------------------------------------------------------------------------
# One 3D pose of two: a lifter's, which knows motion, and a network's, which sees the image.

# Chosen on videos of rendered people (``experiments/pose_fusion.py``).
SHARE = 0.35  # of the other pose, where both agree
APART = 0.15  # m, mean distance of two poses from which one of them is wrong
# Errors of captures are as these products in the mean (``experiments/trust_video.py``).
_ALONE = (1.445, 2.66)  # power of the lifter's own error, and a factor
_TOGETHER = (1.276, 0.505, 5.2)  # powers of that error and of the distance, and a factor
_LEAST = 0.01  # m
_DOUBTED = 2.5  # expected distances of two poses from which a network that was adapted is doubted


def fuse_poses(
    lifted: Detections, seen: Detections | None, share: float = SHARE, apart: float = APART
) -> Detections:
    """Lifted 3D poses, nearer to those that a network saw, where both mean the same.

    The network's poses are brought to the size of the lifted ones (one factor a view) and, frame
    by frame, to their heading: a network of crops knows neither well. Then each joint moves a share
    of the way; less the farther apart the poses are, since then one of them is wrong. How far they
    are apart also tells how far the result may be off, with what the lifter says of itself.

    A network whose error on such footage was measured (``deviation3d`` of ``seen``, from
    ``output.error3d`` of its manifest) gets the share of least square error, if both err
    independently, and is doubted from a distance on that these errors do not explain.

    Args:
        lifted: with 3D poses, (F, C, 16).
        seen: the same frames and views, with 3D poses or without; None if there are none.
        share: of the way, where both mean the same and nobody has measured the network.
        apart: mean distance of two poses at which half of it is left, metres; likewise.
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
    shares, limits = _measured(lifted, seen, share, apart)
    part = torch.where(both, shares / (1 + (distance / limits) ** 6), 0)[..., None, None]
    return replace(
        lifted,
        joints3d=lifted.joints3d + part * (turned - lifted.joints3d),
        deviation3d=_expected(lifted.deviation3d, torch.where(both, distance, torch.nan)),
    )


def _measured(
    lifted: Detections, seen: Detections, share: float, apart: float
) -> tuple[Tensor | float, Tensor | float]:
    """Shares of the other pose and distances at which half is left, (F, C) or numbers."""
    alone = _expected(lifted.deviation3d, None)
    if alone is None or seen.deviation3d is None:
        return share, apart
    own, other = alone.square(), seen.deviation3d.to(alone).square()
    known = other.isfinite() & own.isfinite()
    return (
        torch.where(known, own / (own + other), share),
        torch.where(known, _DOUBTED * (own + other).sqrt(), apart),
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
