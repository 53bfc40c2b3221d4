"""Shares of joints that are near enough, in space and in images."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.metrics.missing import counted_joints, frame_mean

PCK_THRESHOLD = 150.0  # mm, Mehta et al. 2017
AUC_THRESHOLDS = tuple(range(0, 151, 5))  # mm
TORSO_SHARE = 0.2  # of the torso's diagonal, Yang and Ramanan 2013
HEAD_SHARE = 0.5  # of the head's length, Andriluka et al. 2014
_LARGEST_SHARE = 2.0
_TORSO = (5, 8)  # left shoulder, right hip
_HEAD = (0, 1)  # crown, neck


def correct_share(errors: Tensor, valid: Tensor, threshold: float = PCK_THRESHOLD) -> Tensor:
    """Share (*b) of joints with an error (*b, F, J) below a threshold, percent; both mm.

    Args:
        errors: may hold anything where they are not valid.
        valid: frames (*b, F) or joints (*b, F, J) that count.
        threshold: an error of exactly this is too large.
    """
    return 100 * frame_mean((errors < threshold).to(errors.dtype), valid)


def area_under_curve(
    errors: Tensor, valid: Tensor, thresholds: tuple[float, ...] = AUC_THRESHOLDS
) -> Tensor:
    """Share (*b) of joints within a threshold, mean over thresholds up to 150 mm, percent."""
    within = [frame_mean((errors <= at).to(errors.dtype), valid) for at in thresholds]
    return 100 * torch.stack(within).mean(0)


def image_correct_share(
    pixels: Tensor,
    truth: Tensor,
    size: Tensor,
    share: float,
    confidence: Tensor | None = None,
) -> Tensor:
    """2D PCK: joints nearer to the truth than a share of the person's size, (*b), percent.

    Joints that are missing on either side do not count, nor do frames whose size is not a positive
    number.

    Args:
        pixels: (*b, F, J, 2).
        truth: (*b, F, J, 2).
        size: of the person in each frame, (*b, F), px: ``torso_size`` or ``head_size``.
        share: of the size, ``TORSO_SHARE`` or ``HEAD_SHARE``.
        confidence: (*b, F, J); joints of confidence 0 or NaN are missing.

    Raises:
        InputError: shapes that do not belong together, or a share that is none.
    """
    if not 0 < share <= _LARGEST_SHARE:
        raise InputError(
            f"share is {share}, expected one such as {TORSO_SHARE} of the torso; divide percents "
            "by 100"
        )
    valid = counted_joints(pixels, truth, confidence, partial=True)
    if size.shape != valid.shape[:-1]:
        raise InputError(
            f"size has shape {tuple(size.shape)} for joints {tuple(pixels.shape)}; give one number "
            "a frame, (*b, F)"
        )
    known = size.isfinite() & (size > 0)
    relative = (pixels - truth).norm(dim=-1) / torch.where(known, size, 1).unsqueeze(-1)
    return correct_share(relative, valid & known.unsqueeze(-1), share)


def torso_size(truth: Tensor, ends: tuple[int, int] = _TORSO) -> Tensor:
    """Left shoulder to right hip (*b, F) of joints (*b, F, J, 2), px; NaN where one is missing."""
    return _length(truth, ends)


def head_size(truth: Tensor, ends: tuple[int, int] = _HEAD) -> Tensor:
    """Crown to neck (*b, F) of joints (*b, F, J, 2), px; NaN where one is missing.

    PCKh of MPII divides by 0.6 of the diagonal of an annotated head box instead, which joints do
    not have; its numbers are near these, not equal.
    """
    return _length(truth, ends)


def _length(points: Tensor, ends: tuple[int, int]) -> Tensor:
    length: Tensor = torch.linalg.vector_norm(
        points[..., ends[0], :] - points[..., ends[1], :], dim=-1
    )
    return length
