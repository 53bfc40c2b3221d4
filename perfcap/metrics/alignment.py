"""What is removed from an estimate before it is compared with the truth.

Positions are (*b, F, J, 3) in metres. Joints that do not count may hold anything; they take no part
in an alignment and stay where that moves them.
"""

from __future__ import annotations

from enum import StrEnum

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.alignment import similarity_align
from perfcap.metrics.missing import check_mask, check_metres, check_same_joints, masked

HIPS = (8, 12)  # of the 16 landmarks; their middle is the root
NECK = 1
TRUNK = (8, 12, NECK)  # right hip, left hip, neck: what tells which way a body faces


class Alignment(StrEnum):
    """Alignments by the names that protocols and tables use."""

    ABSOLUTE = "absolute"
    ROOT = "root"
    TRANSLATION = "translation"
    SIMILARITY = "similarity"
    FIRST_FRAME = "first frame"


def align(
    estimate: Tensor,
    truth: Tensor,
    valid: Tensor,
    alignment: Alignment | str,
    hips: tuple[int, int] = HIPS,
    trunk: tuple[int, int, int] = TRUNK,
) -> Tensor:
    """The estimate (*b, F, J, 3), moved onto the truth as far as an alignment goes.

    Args:
        estimate: metres.
        truth: metres.
        valid: joints that count, (*b, F, J).
        alignment: which, or its name.
        hips: the joints whose middle is the root; a frame that lacks one cannot be root-aligned
            and becomes NaN.
        trunk: right hip, left hip and neck, for ``FIRST_FRAME``.

    Raises:
        InputError: an alignment of no known name, ``valid`` is no mask, or joints of other frames
            or in another unit.
    """
    check_mask(valid)
    check_same_joints(estimate, truth)
    check_metres(estimate=masked(estimate, valid), truth=masked(truth, valid))
    return moved_onto(estimate, truth, valid, alignment, hips, trunk)


def moved_onto(
    estimate: Tensor,
    truth: Tensor,
    valid: Tensor,
    alignment: Alignment | str,
    hips: tuple[int, int] = HIPS,
    trunk: tuple[int, int, int] = TRUNK,
) -> Tensor:
    """``align`` of joints that are known to belong together."""
    alignment = _known(alignment)
    if alignment is Alignment.ROOT:
        return estimate + (root_of(truth, hips) - root_of(estimate, hips)).unsqueeze(-2)
    if alignment is Alignment.TRANSLATION:
        return estimate + _mean(truth - estimate, valid)
    if alignment is Alignment.SIMILARITY:
        return similarity_align(estimate, truth, valid.to(estimate.dtype))
    if alignment is Alignment.FIRST_FRAME:
        return without_first_offset(estimate, truth, valid, trunk)
    return estimate


def _known(alignment: Alignment | str) -> Alignment:
    try:
        return Alignment(alignment)
    except ValueError:
        names = ", ".join(map(repr, map(str, Alignment)))
        raise InputError(f"alignment is {alignment!r}, expected one of {names}") from None


def root_of(points: Tensor, hips: tuple[int, int] = HIPS) -> Tensor:
    """Middle of the hips, (*b, F, 3)."""
    first, second = hips
    return 0.5 * (points[..., first, :] + points[..., second, :])


def root_aligned(points: Tensor, hips: tuple[int, int] = HIPS) -> Tensor:
    """Joints (*b, F, J, 3) relative to the middle of the hips, metres."""
    return points - root_of(points, hips).unsqueeze(-2)


def without_first_offset(
    estimate: Tensor, truth: Tensor, valid: Tensor, trunk: tuple[int, int, int] = TRUNK
) -> Tensor:
    """The estimate without the constant offset each joint has in its first valid frame.

    Two skeletons place "the same" joint differently in a body: markers on the skin, joints within
    (Rhodin et al. 2016, Sec. 6, score HumanEva so). The offset is taken along the axes of the
    estimated body, so it turns with the person: a rigid estimate that is off by a constant in the
    body has no error left. The truth needs no trunk: frames and joints whose truth is missing say
    nothing about those that are there.

    Args:
        estimate: (*b, F, J, 3), metres; NaN where it is not known.
        truth: (*b, F, J, 3), metres.
        valid: joints that count, (*b, F, J).
        trunk: right hip, left hip and neck.

    Returns:
        (*b, F, J, 3), metres; NaN in frames in which the estimate lacks a joint of the trunk, and
        for joints that never count.
    """
    axes = body_axes(estimate, trunk)  # *b F 3 3
    offset = (truth - estimate) @ axes  # rows times axes: into the body
    usable = valid & offset.isfinite().all(-1)
    first = usable.to(torch.uint8).argmax(-2, keepdim=True)  # the first maximum
    chosen = first.unsqueeze(-1).expand(*first.shape, 3)
    return estimate + offset.gather(-3, chosen) @ axes.mT


def body_axes(points: Tensor, trunk: tuple[int, int, int] = TRUNK) -> Tensor:
    """Axes of the trunk as columns (right, up, back), (*b, F, 3, 3); NaN where it lacks a joint."""
    right_hip, left_hip, neck = (points[..., joint, :] for joint in trunk)
    up = torch.nn.functional.normalize(neck - 0.5 * (right_hip + left_hip), dim=-1)
    across = right_hip - left_hip
    right = across - (across * up).sum(-1, keepdim=True) * up
    right = torch.nn.functional.normalize(right, dim=-1)
    return torch.stack((right, up, torch.linalg.cross(right, up)), -1)


def _mean(offset: Tensor, valid: Tensor) -> Tensor:
    """Mean over valid joints, (*b, F, 1, 3)."""
    kept = valid.unsqueeze(-1)
    total = torch.where(kept, offset, torch.zeros_like(offset)).sum(-2, keepdim=True)
    return total / kept.sum(-2, keepdim=True)
