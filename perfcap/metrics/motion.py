"""How a motion moves: smoothness, bones that keep their lengths, angles, limits."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.metrics.missing import check_metres, check_radians, check_same_joints, frame_mean
from perfcap.rates import frame_rate, rate_doubts
from perfcap.setting_checks import require_number

_MILLIMETRES = 1000.0  # in a metre


@dataclass(frozen=True)
class LimitViolations:
    """How far angles leave their limits, each (*b).

    Attributes:
        share: angles outside, percent of all angles of all frames that count.
        worst: largest excess, radians; 0 when there is none.
    """

    share: Tensor
    worst: Tensor


def acceleration_error(estimate: Tensor, truth: Tensor, *, partial: bool = False) -> Tensor:
    """Mean distance of second differences, (*b), mm per squared frame.

    Over the frames that are complete together with both neighbours; NaN if there are none.

    Args:
        estimate: (*b, F, J, 3), metres.
        truth: (*b, F, J, 3), metres.
        partial: whether frames count with the joints that are complete.

    Raises:
        InputError: shapes that do not belong together, or joints in another unit.
    """
    check_same_joints(estimate, truth)
    check_metres(estimate=estimate, truth=truth)
    error = _MILLIMETRES * (estimate - truth).diff(n=2, dim=-3).norm(dim=-1)
    return _mean(error, partial)


def jerk(points: Tensor, fps: float, *, partial: bool = False) -> Tensor:
    """Mean length of third differences over time, (*b), m/s^3.

    Over runs of four complete frames; NaN if there are none.

    Args:
        points: (*b, F, J, 3), metres.
        fps: frames a second; seconds of a frame get a warning.
        partial: whether frames count with the joints that are complete.

    Raises:
        InputError: joints in another unit, or a rate that is none.
    """
    fps = frame_rate(fps, "fps")
    for line in rate_doubts(fps):
        warnings.warn(f"jerk: {line}", stacklevel=2)
    check_same_joints(points, points)
    check_metres(points=points)
    return _mean(points.diff(n=3, dim=-3).norm(dim=-1) * fps**3, partial)


def bone_length_variation(points: Tensor, bones: Sequence[tuple[int, int]]) -> Tensor:
    """Standard deviation of bone lengths over time, mean over bones, (*b), mm.

    Zero for a skeleton that keeps its bones; the classic sign of per-frame detections.

    Args:
        points: joints (*b, F, J, 3), metres.
        bones: pairs of joints.

    Raises:
        InputError: joints in another unit, or bones of others.
    """
    check_metres(points=points)
    lengths = _MILLIMETRES * _bones(points, bones).norm(dim=-1)
    valid = lengths.isfinite().all(-1, keepdim=True)
    count = valid.sum(-2, keepdim=True)
    lengths = torch.where(valid, lengths, torch.zeros_like(lengths))
    deviation = torch.where(valid, lengths - lengths.sum(-2, keepdim=True) / count, 0)
    variation: Tensor = (deviation.square().sum(-2) / count.squeeze(-2)).sqrt().mean(-1)
    return variation


def bone_angle_error(estimate: Tensor, truth: Tensor, bones: Sequence[tuple[int, int]]) -> Tensor:
    """Mean angle between bones and true bones, (*b), degrees.

    Independent of bone lengths and of where the person stands. A bone that lacks an end, or has no
    length, on either side does not count.

    Args:
        estimate: joints (*b, F, J, 3).
        truth: joints (*b, F, J, 3).
        bones: pairs of joints.
    """
    check_same_joints(estimate, truth)
    found, true = _bones(estimate, bones), _bones(truth, bones)
    # atan2 is exact at 0 and 180 degrees, where arccos loses half of the digits
    sine = torch.linalg.cross(found, true).norm(dim=-1)
    angle = torch.rad2deg(torch.atan2(sine, (found * true).sum(-1)))
    lengths = found.norm(dim=-1) * true.norm(dim=-1)
    return frame_mean(angle, lengths.isfinite() & (lengths > 0))


def angle_error(angles: Tensor, truth: Tensor) -> Tensor:
    """Mean distance of joint angles on the circle, (*b), degrees.

    Args:
        angles: (*b, F, A), radians; a NaN does not count.
        truth: (*b, F, A), radians, of the same rig.

    Raises:
        InputError: the shapes differ, or angles are in degrees.
    """
    if angles.shape != truth.shape or angles.dim() < 2:
        raise InputError(
            f"angles have shape {tuple(angles.shape)} and truth {tuple(truth.shape)}; give angles "
            "of the same rig and frames as (*b, F, A)"
        )
    check_radians(angles=angles, truth=truth)
    turn = torch.remainder(angles - truth + math.pi, 2 * math.pi) - math.pi
    return frame_mean(torch.rad2deg(turn.abs()), turn.isfinite())


def limit_violations(
    angles: Tensor, lower: Tensor, upper: Tensor, tolerance: float = 1e-6
) -> LimitViolations:
    """Angles (*b, F, A) against limits (A,), radians; frames with a NaN angle are left out.

    Args:
        angles: radians.
        lower: radians.
        upper: radians.
        tolerance: an excess up to this is rounding, radians.

    Raises:
        InputError: limits of other angles, a lower one above its upper one, or no tolerance.
    """
    require_number(tolerance, "tolerance", least=0)
    if lower.shape != upper.shape or lower.shape != angles.shape[-1:] or angles.dim() < 2:
        raise InputError(
            f"angles have shape {tuple(angles.shape)}, limits {tuple(lower.shape)} and "
            f"{tuple(upper.shape)}; give (*b, F, A) and (A,) twice, of the same rig"
        )
    if not bool((lower <= upper).all()):
        raise InputError("a lower limit is above its upper limit, or one is NaN; expected radians")
    check_radians(angles=angles, lower=lower, upper=upper)
    valid = angles.isfinite().all(-1)
    excess = torch.maximum(lower - angles, angles - upper).clamp(min=0)
    outside = (excess > tolerance).to(angles.dtype)
    counted = torch.where(valid.unsqueeze(-1), outside * excess, torch.zeros_like(excess))
    worst = torch.where(valid.any(-1), counted.amax((-2, -1)), torch.nan)
    return LimitViolations(100 * frame_mean(outside, valid), worst)


def _bones(points: Tensor, bones: Sequence[tuple[int, int]]) -> Tensor:
    joints = points.shape[-2]
    if not bones or not all(isinstance(bone, tuple | list) for bone in bones):
        raise InputError(f"bones are {bones!r:.80}, expected pairs of joints, as [(0, 1), (1, 2)]")
    ends = torch.tensor(bones, device=points.device)
    if ends.shape != (len(bones), 2) or not 0 <= int(ends.min()) <= int(ends.max()) < joints:
        raise InputError(f"bones are {bones!r:.80}, expected pairs of the joints 0 to {joints - 1}")
    return points[..., ends[:, 1], :] - points[..., ends[:, 0], :]


def _mean(values: Tensor, partial: bool) -> Tensor:
    finite = values.isfinite()
    return frame_mean(values, finite if partial else finite.all(-1))
