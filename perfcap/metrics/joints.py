"""Joint errors as the field reports them.

Positions are (*b, F, J, 3) in metres, results (*b) in the unit each function names. A frame with
any missing joint (see ``perfcap.metrics.missing``) is *missing*: it is left out of every mean, and
counted; with ``partial`` it counts with the joints it has. A mean over nothing is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.metrics.alignment import HIPS, TRUNK, Alignment, moved_onto
from perfcap.metrics.missing import (
    check_mask,
    check_metres,
    check_pixels,
    check_places,
    check_same_joints,
    counted_joints,
    frame_mean,
    joint_mean,
    masked,
)
from perfcap.metrics.motion import acceleration_error, jerk
from perfcap.metrics.shares import area_below, share_below

MILLIMETRES = 1000.0  # in a metre
_LANDMARKS = 16
# joints that always coincide after it
_FITTED: dict[str, int] = {Alignment.TRANSLATION: 1, Alignment.SIMILARITY: 2}


@dataclass(frozen=True)
class JointErrors:
    """Errors of one estimate, each (*b).

    Attributes:
        frames: frames that count.
        missing: frames left out.
        missing_joints: joints left out of the frames that count.
        mpjpe: mean distance in the world, mm.
        mpjpe_root: the same, both roots moved to the origin, mm.
        mpjpe_translation: after the best translation of each frame, mm.
        mpjpe_similarity: after the best similarity of each frame (PA-MPJPE), mm.
        mpjpe_first_frame: without the offset in the body that each joint has at first, mm.
        pck: joints nearer than 150 mm with the roots aligned, percent.
        auc: mean of that share over the thresholds 0, 5, ... 150 mm, percent.
        acceleration_error: mm per squared frame.
        jerk: of the estimate, m/s^3.
        jerk_truth: of the truth over the same frames, m/s^3.
        frames_root: frames of mpjpe_root, pck and auc; with ``partial`` fewer than ``frames`` where
            some lack a hip.
        frames_translation: frames of mpjpe_translation; fewer where some have one joint only.
        frames_similarity: frames of mpjpe_similarity; fewer where some have two joints or one.
        frames_first_frame: frames of mpjpe_first_frame; fewer where some lack a joint of the
            estimated trunk.
    """

    frames: Tensor
    missing: Tensor
    missing_joints: Tensor
    mpjpe: Tensor
    mpjpe_root: Tensor
    mpjpe_translation: Tensor
    mpjpe_similarity: Tensor
    mpjpe_first_frame: Tensor
    pck: Tensor
    auc: Tensor
    acceleration_error: Tensor
    jerk: Tensor
    jerk_truth: Tensor
    frames_root: Tensor
    frames_translation: Tensor
    frames_similarity: Tensor
    frames_first_frame: Tensor


def joint_errors(
    estimate: Tensor,
    truth: Tensor,
    fps: float,
    hips: tuple[int, int] | None = None,
    *,
    trunk: tuple[int, int, int] | None = None,
    confidence: Tensor | None = None,
    partial: bool = False,
) -> JointErrors:
    """All errors of joints (*b, F, J, 3) against the truth.

    Args:
        estimate: metres; NaN where nothing was estimated.
        truth: metres.
        fps: frames a second.
        hips: the two joints whose middle is the root; those of the 16 landmarks if not given.
        trunk: right hip, left hip and neck, the axes of the first frame's offsets; likewise.
        confidence: (*b, F, J); joints of confidence 0 or NaN are missing.
        partial: whether frames with missing joints count with those they have.

    Raises:
        InputError: shapes that do not belong together, another unit than metres, other joints than
            the 16 landmarks without their hips and trunk, or joints at 0, 0, 0 that count.
    """
    check_same_joints(estimate, truth)
    check_metres(estimate=estimate, truth=truth)
    hips, trunk = _named(estimate, hips, trunk)
    # a truth is often more precise than an estimate
    kind = torch.promote_types(torch.promote_types(estimate.dtype, truth.dtype), torch.float32)
    estimate, truth = estimate.to(kind), truth.to(kind)
    valid = counted_joints(estimate, truth, confidence, partial)
    check_places(truth, valid)
    check_places(estimate, valid, "estimate")
    counts = valid.any(-1)
    known = estimate.isfinite().all(-1)
    if confidence is not None:
        known = known & (confidence > 0)
    apart = {
        kind: aligned_distances(estimate, truth, valid, kind, hips, trunk, known)
        for kind in Alignment
    }
    means = {kind: frame_mean(each, each.isfinite()) for kind, each in apart.items()}
    used = {kind: each.isfinite().any(-1).sum(-1) for kind, each in apart.items()}
    root = apart[Alignment.ROOT]
    seen = [masked(points, valid) for points in (estimate, truth)]
    return JointErrors(
        frames=counts.sum(-1),
        missing=(~counts).sum(-1),
        missing_joints=(counts.unsqueeze(-1) & ~valid).sum((-2, -1)),
        mpjpe=means[Alignment.ABSOLUTE],
        mpjpe_root=means[Alignment.ROOT],
        mpjpe_translation=means[Alignment.TRANSLATION],
        mpjpe_similarity=means[Alignment.SIMILARITY],
        mpjpe_first_frame=means[Alignment.FIRST_FRAME],
        pck=share_below(root, root.isfinite()),
        auc=area_below(root, root.isfinite()),
        acceleration_error=acceleration_error(*seen, partial=partial),
        jerk=jerk(seen[0], fps, partial=partial),
        jerk_truth=jerk(seen[1], fps, partial=partial),
        frames_root=used[Alignment.ROOT],
        frames_translation=used[Alignment.TRANSLATION],
        frames_similarity=used[Alignment.SIMILARITY],
        frames_first_frame=used[Alignment.FIRST_FRAME],
    )


def _named(
    points: Tensor, hips: tuple[int, int] | None, trunk: tuple[int, int, int] | None
) -> tuple[tuple[int, int], tuple[int, int, int]]:
    """Hips and trunk; joints of another number than the landmarks have them elsewhere."""
    count = points.shape[-2]
    if count != _LANDMARKS and (hips is None or trunk is None):
        raise InputError(
            f"there are {count} joints, not the {_LANDMARKS} landmarks; say which are the hips and "
            "the trunk: hips=(right, left), trunk=(right hip, left hip, neck)"
        )
    hips, trunk = hips or HIPS, trunk or TRUNK
    if not all(joint in range(count) for joint in (*hips, *trunk)):
        raise InputError(f"hips {hips} and trunk {trunk} are not among {count} joints")
    if len(set(trunk)) < len(trunk):
        raise InputError(f"trunk is {trunk}, expected three joints: right hip, left hip, neck")
    return hips, trunk


def distances(estimate: Tensor, truth: Tensor) -> Tensor:
    """Distance of each joint, (*b, F, J), mm."""
    apart: Tensor = torch.linalg.vector_norm(estimate - truth, dim=-1)
    return MILLIMETRES * apart


def aligned_distances(
    estimate: Tensor,
    truth: Tensor,
    valid: Tensor,
    alignment: Alignment | str,
    hips: tuple[int, int] = HIPS,
    trunk: tuple[int, int, int] = TRUNK,
    known: Tensor | None = None,
) -> Tensor:
    """Distance of each joint after an alignment, (*b, F, J), mm; NaN where joints do not count.

    Nor do frames of so few joints that any estimate would fit: one after a translation, two after
    a similarity; nor, with the roots aligned, frames in which a hip does not count.

    Args:
        estimate: (*b, F, J, 3), metres.
        truth: (*b, F, J, 3), metres.
        valid: joints that count, (*b, F, J).
        alignment: what is removed first, or its name.
        hips: the two joints whose middle is the root.
        trunk: right hip, left hip and neck.
        known: joints of the estimate that may tell how its trunk is turned, (*b, F, J), for
            ``FIRST_FRAME``: also those whose truth is missing. Those that count if not given.

    Raises:
        InputError: ``valid`` or ``known`` is no mask, an alignment of no known name, or joints of
            other frames or in another unit.
    """
    check_mask(valid)
    check_same_joints(estimate, truth)
    check_metres(estimate=masked(estimate, valid), truth=masked(truth, valid))
    # an alignment is not asked about joints that do not count: no NaN enters the arithmetic
    kept = [torch.where(valid.unsqueeze(-1), points, 0) for points in (estimate, truth)]
    if alignment in (Alignment.ROOT, Alignment.FIRST_FRAME):
        kept = [masked(points, valid) for points in (estimate, truth)]
    if alignment == Alignment.FIRST_FRAME and known is not None:
        check_mask(known)
        # of the axes nothing is asked of the truth: a hip that it lacks leaves them as they are
        kept[0] = masked(estimate, known)
    apart = distances(moved_onto(kept[0], kept[1], valid, alignment, hips, trunk), kept[1])
    told = valid & (valid.sum(-1, keepdim=True) > _FITTED.get(alignment, 0))
    return torch.where(told, apart, torch.nan)


def joint_table(errors: Tensor, names: Sequence[str]) -> dict[str, Tensor]:
    """Mean error (*b) of each joint, by name; NaN for joints that never count.

    Args:
        errors: (*b, F, J), as ``aligned_distances`` gives them.
        names: J.

    Raises:
        InputError: not one name a joint.
    """
    if errors.dim() < 2 or errors.shape[-1] != len(names):
        raise InputError(
            f"errors have shape {tuple(errors.shape)} for {len(names)} names; give (*b, F, J)"
        )
    means = joint_mean(errors, errors.isfinite())
    return {name: means[..., index] for index, name in enumerate(names)}


def action_table(errors: Mapping[str, Sequence[Tensor]]) -> dict[str, Tensor]:
    """Mean error of each action over all joints of its takes, and ``mean``, that of the actions.

    The mean of actions is what Human3.6M tables print: short actions weigh as much as long ones.

    Args:
        errors: (F, J) of each take, by action; NaN where joints do not count.
    """
    means = {
        action: torch.cat([take.reshape(-1) for take in takes]).nanmean()
        for action, takes in errors.items()
    }
    return means | {"mean": torch.stack(list(means.values())).nanmean()} if means else {}


def reprojection_error(pixels: Tensor, truth: Tensor, *, partial: bool = False) -> Tensor:
    """Mean distance (*b) of projected joints (*b, F, J, 2) in the frames that are complete, px.

    Args:
        pixels: (*b, F, J, 2), px; NaN where nothing was projected.
        truth: (*b, F, J, 2), px; NaN where nothing was annotated.
        partial: whether frames with missing joints count with those they have.

    Returns:
        Mean over all joints that count, each as much as any other; NaN where none does.

    Raises:
        InputError: shapes that do not belong together, joints in space, or shares of an image.
    """
    valid = counted_joints(pixels, truth, partial=partial)
    check_pixels(pixels, truth, valid)
    return frame_mean((pixels - truth).norm(dim=-1), valid)
