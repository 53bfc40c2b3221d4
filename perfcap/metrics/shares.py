"""Shares of joints that are near enough to the truth, in space and in images.

Errors are (*b, F, J), shares (*b) in percent. What is missing (see ``perfcap.metrics.missing``)
does not count; a share of nothing is NaN.
"""

from __future__ import annotations

import warnings

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.metrics.missing import counted_joints, frame_mean
from perfcap.setting_checks import require_size

PCK_THRESHOLD = 150.0  # mm, Mehta et al. 2017
AUC_THRESHOLDS = tuple(range(0, 151, 5))  # mm
TORSO_SHARE = 0.2  # of the torso's diagonal, Yang and Ramanan 2013
HEAD_SHARE = 0.5  # of the head's length, Andriluka et al. 2014
_LARGEST_SHARE = 2.0
_NEAR = 0.005  # of the largest threshold: so near are metres, and hardly an estimate
# Of what joints span, of a torso, a head or a box; and joints of a frame that show it
_LARGEST_SIZE, _SMALLEST_SIZE, _WHOLE = 2.0, 0.01, 8
_TORSO = (5, 8)  # left shoulder, right hip
_HEAD = (0, 1)  # crown, neck


def correct_share(errors: Tensor, valid: Tensor, threshold: float = PCK_THRESHOLD) -> Tensor:
    """Share (*b) of joints with an error (*b, F, J) below a threshold, percent; both mm.

    Args:
        errors: may hold anything where they are not valid.
        valid: frames (*b, F) or joints (*b, F, J) that count.
        threshold: an error of exactly this is too large.

    Raises:
        InputError: a threshold that is no number above zero.

    Warns of errors that are all far below the threshold, as metres are.
    """
    require_size(threshold, "threshold")
    _warn_of_metres(errors, valid, threshold)
    return share_below(errors, valid, threshold)


def share_below(errors: Tensor, valid: Tensor, threshold: float = PCK_THRESHOLD) -> Tensor:
    """``correct_share`` of errors whose unit is known."""
    return 100 * frame_mean((errors < threshold).to(errors.dtype), valid)


def area_under_curve(
    errors: Tensor, valid: Tensor, thresholds: tuple[float, ...] = AUC_THRESHOLDS
) -> Tensor:
    """Share (*b) of joints within a threshold, mean over thresholds up to 150 mm, percent.

    Raises:
        InputError: no threshold, or one that is below zero.

    Warns of errors that are all far below the thresholds, as metres are.
    """
    if not thresholds or not all(at >= 0 for at in thresholds):
        raise InputError(f"thresholds are {thresholds!r:.80}, expected one or more from 0 mm on")
    _warn_of_metres(errors, valid, max(thresholds))
    return area_below(errors, valid, thresholds)


def area_below(
    errors: Tensor, valid: Tensor, thresholds: tuple[float, ...] = AUC_THRESHOLDS
) -> Tensor:
    """``area_under_curve`` of errors whose unit is known."""
    within = [frame_mean((errors <= at).to(errors.dtype), valid) for at in thresholds]
    return 100 * torch.stack(within).mean(0)


def _warn_of_metres(errors: Tensor, valid: Tensor, largest: float) -> None:
    """Warn of errors that are all far below thresholds: metres beside millimetres are all near."""
    counts = valid if valid.dim() == errors.dim() else valid.unsqueeze(-1).expand_as(errors)
    known = (
        errors.detach()[counts & errors.isfinite()] if counts.dtype == torch.bool else errors[:0]
    )
    worst = float(known.max()) if known.numel() else 0.0
    if 0 < worst < _NEAR * largest:
        warnings.warn(
            f"errors are {worst:.3g} at most beside a threshold of {largest:.6g}: expected both in "
            "millimetres; multiply metres by 1000",
            stacklevel=3,
        )


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
        InputError: shapes that do not belong together, a share that is none, or sizes larger than
            people or far smaller.
    """
    if not 0 < share <= _LARGEST_SHARE:
        raise InputError(
            f"share is {share}, expected one such as {TORSO_SHARE} of the torso; divide percents "
            "by 100"
        )
    if pixels.shape[-1:] != (2,):
        raise InputError(f"pixels have shape {tuple(pixels.shape)}, expected (*b, F, J, 2)")
    valid = counted_joints(pixels, truth, confidence, partial=True)
    if size.shape != valid.shape[:-1]:
        raise InputError(
            f"size has shape {tuple(size.shape)} for joints {tuple(pixels.shape)}; give one number "
            "a frame, (*b, F)"
        )
    known = size.isfinite() & (size > 0)
    _require_size_of(truth, valid, size.where(known, torch.nan))
    relative = (pixels - truth).norm(dim=-1) / torch.where(known, size, 1).unsqueeze(-1)
    return share_below(relative, valid & known.unsqueeze(-1), share)


def _require_size_of(truth: Tensor, valid: Tensor, size: Tensor) -> None:
    """Refuse sizes (*b, F) in other units than joints (*b, F, J, 2): all or none are near enough.

    Raises:
        InputError: torsos or heads are most often larger than what all joints span, or far smaller.
    """
    seen = valid.unsqueeze(-1)
    high, low = (
        part(truth.where(seen, sign * torch.inf), -2)
        for part, sign in ((torch.amax, -1), (torch.amin, 1))
    )
    span = (high - low).norm(dim=-1)
    whole = (valid.sum(-1) >= _WHOLE) & (span > 0)
    times = (size / span).where(whole, torch.nan).nanmedian()
    if float(times) > _LARGEST_SIZE:
        raise InputError(
            f"size is {float(times):.3g} times what the true joints span from end to end, so that "
            "any joint would be near enough; expected a torso or a head in pixels of the joints"
        )
    if float(times) < _SMALLEST_SIZE:
        raise InputError(
            f"size is {float(times):.3g} of what the true joints span from end to end, so that no "
            "joint would be near enough; expected a torso or a head in pixels of the joints"
        )


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
