"""Joint errors as the field reports them.

Positions are (*b, F, J, 3) in metres, results (*b) in the unit each function names. A frame with
any joint that is not finite, in estimate or truth, is *missing*: it is left out of every mean, and
counted. A mean over no frames is NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.alignment import similarity_align

MILLIMETRES = 1000.0  # in a metre
HIPS = (8, 12)  # of the 16 landmarks; their middle is the root
PCK_THRESHOLD = 150.0  # mm, Mehta et al. 2017
AUC_THRESHOLDS = tuple(range(0, 151, 5))  # mm


@dataclass(frozen=True)
class JointErrors:
    """Errors of one estimate, each (*b).

    Attributes:
        frames: frames that count.
        missing: frames left out.
        mpjpe: mean distance in the world, mm.
        mpjpe_root: the same, both roots moved to the origin, mm.
        mpjpe_translation: after the best translation of each frame, mm.
        mpjpe_similarity: after the best similarity of each frame (PA-MPJPE), mm.
        pck: joints nearer than 150 mm with the roots aligned, percent.
        auc: mean of that share over the thresholds 0, 5, ... 150 mm, percent.
        acceleration_error: mm per squared frame.
        jerk: of the estimate, m/s^3.
        jerk_truth: of the truth over the same frames, m/s^3.
    """

    frames: Tensor
    missing: Tensor
    mpjpe: Tensor
    mpjpe_root: Tensor
    mpjpe_translation: Tensor
    mpjpe_similarity: Tensor
    pck: Tensor
    auc: Tensor
    acceleration_error: Tensor
    jerk: Tensor
    jerk_truth: Tensor


@dataclass(frozen=True)
class LimitViolations:
    """How far angles leave their limits, each (*b).

    Attributes:
        share: angles outside, percent of all angles of all frames that count.
        worst: largest excess, radians; 0 when there is none.
    """

    share: Tensor
    worst: Tensor


def joint_errors(
    estimate: Tensor, truth: Tensor, fps: float, hips: tuple[int, int] = HIPS
) -> JointErrors:
    """All errors of joints (*b, F, J, 3) against the truth.

    Args:
        estimate: metres; NaN where nothing was estimated.
        truth: metres.
        fps: frames a second.
        hips: the two joints whose middle is the root.
    """
    _check(estimate, truth)
    valid = complete(estimate) & complete(truth)
    root = distances(root_aligned(estimate, hips), root_aligned(truth, hips))
    both_jerks = [jerk(_masked(points, valid), fps) for points in (estimate, truth)]
    return JointErrors(
        frames=valid.sum(-1),
        missing=(~valid).sum(-1),
        mpjpe=frame_mean(distances(estimate, truth), valid),
        mpjpe_root=frame_mean(root, valid),
        mpjpe_translation=frame_mean(distances(_centred(estimate), _centred(truth)), valid),
        mpjpe_similarity=frame_mean(_similarity_distances(estimate, truth, valid), valid),
        pck=correct_share(root, valid),
        auc=area_under_curve(root, valid),
        acceleration_error=acceleration_error(estimate, truth),
        jerk=both_jerks[0],
        jerk_truth=both_jerks[1],
    )


def complete(points: Tensor) -> Tensor:
    """Frames (*b, F) of points (*b, F, J, d) in which every joint is finite."""
    return points.isfinite().all(-1).all(-1)


def distances(estimate: Tensor, truth: Tensor) -> Tensor:
    """Distance of each joint, (*b, F, J), mm."""
    apart: Tensor = torch.linalg.vector_norm(estimate - truth, dim=-1)
    return MILLIMETRES * apart


def frame_mean(values: Tensor, valid: Tensor) -> Tensor:
    """Mean (*b) of values (*b, F, J) over the joints of valid frames (*b, F); NaN over none."""
    kept = torch.where(valid.unsqueeze(-1), values, torch.zeros_like(values))
    return kept.sum((-2, -1)) / (valid.sum(-1) * values.shape[-1])


def root_aligned(points: Tensor, hips: tuple[int, int] = HIPS) -> Tensor:
    """Joints (*b, F, J, 3) relative to the middle of the hips, metres."""
    left, right = hips
    return points - 0.5 * (points[..., left, None, :] + points[..., right, None, :])


def correct_share(errors: Tensor, valid: Tensor, threshold: float = PCK_THRESHOLD) -> Tensor:
    """Share (*b) of joints with an error (*b, F, J) below a threshold, percent; both mm."""
    return 100 * frame_mean((errors < threshold).to(errors.dtype), valid)


def area_under_curve(errors: Tensor, valid: Tensor) -> Tensor:
    """Share (*b) of joints within a threshold, mean over thresholds up to 150 mm, percent."""
    within = [frame_mean((errors <= at).to(errors.dtype), valid) for at in AUC_THRESHOLDS]
    return 100 * torch.stack(within).mean(0)


def acceleration_error(estimate: Tensor, truth: Tensor) -> Tensor:
    """Mean distance of second differences, (*b), mm per squared frame.

    Over the frames that are complete together with both neighbours; NaN if there are none.
    """
    error = MILLIMETRES * (estimate - truth).diff(n=2, dim=-3).norm(dim=-1)
    return frame_mean(error, error.isfinite().all(-1))


def jerk(points: Tensor, fps: float) -> Tensor:
    """Mean length of third differences over time, (*b), m/s^3.

    Over runs of four complete frames; NaN if there are none.
    """
    size = points.diff(n=3, dim=-3).norm(dim=-1) * fps**3
    return frame_mean(size, size.isfinite().all(-1))


def reprojection_error(pixels: Tensor, truth: Tensor) -> Tensor:
    """Mean distance (*b) of projected joints (*b, F, J, 2) in the frames that are complete, px."""
    _check(pixels, truth)
    return frame_mean((pixels - truth).norm(dim=-1), complete(pixels) & complete(truth))


def bone_length_variation(points: Tensor, bones: Sequence[tuple[int, int]]) -> Tensor:
    """Standard deviation of bone lengths over time, mean over bones, (*b), mm.

    Zero for a skeleton that keeps its bones; the classic sign of per-frame detections.

    Args:
        points: joints (*b, F, J, 3), metres.
        bones: pairs of joints.
    """
    ends = torch.tensor(bones, device=points.device)
    lengths = distances(points[..., ends[:, 0], :], points[..., ends[:, 1], :])
    valid = lengths.isfinite().all(-1, keepdim=True)
    count = valid.sum(-2, keepdim=True)
    lengths = torch.where(valid, lengths, torch.zeros_like(lengths))
    deviation = torch.where(valid, lengths - lengths.sum(-2, keepdim=True) / count, 0)
    return (deviation.square().sum(-2) / count.squeeze(-2)).sqrt().mean(-1)


def limit_violations(
    angles: Tensor, lower: Tensor, upper: Tensor, tolerance: float = 1e-6
) -> LimitViolations:
    """Angles (*b, F, A) against limits (A,), radians; frames with a NaN angle are left out.

    Args:
        angles: radians.
        lower: radians.
        upper: radians.
        tolerance: an excess up to this is rounding, radians.
    """
    valid = angles.isfinite().all(-1)
    excess = torch.maximum(lower - angles, angles - upper).clamp(min=0)
    outside = (excess > tolerance).to(angles.dtype)
    counted = torch.where(valid.unsqueeze(-1), outside * excess, torch.zeros_like(excess))
    return LimitViolations(100 * frame_mean(outside, valid), counted.amax((-2, -1)))


def _centred(points: Tensor) -> Tensor:
    return points - points.mean(-2, keepdim=True)


def _similarity_distances(estimate: Tensor, truth: Tensor, valid: Tensor) -> Tensor:
    # alignment is not asked about missing frames: their distances are left out later
    kept = [torch.where(valid[..., None, None], points, 0) for points in (estimate, truth)]
    return distances(similarity_align(kept[0], kept[1]), kept[1])


def _masked(points: Tensor, valid: Tensor) -> Tensor:
    return torch.where(valid[..., None, None], points, torch.nan)


def _check(estimate: Tensor, truth: Tensor) -> None:
    if estimate.shape != truth.shape or estimate.dim() < 3:
        raise InputError(
            f"estimate has shape {tuple(estimate.shape)} and truth {tuple(truth.shape)}; give "
            "joints of the same frames as (*b, F, J, d)"
        )
