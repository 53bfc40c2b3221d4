"""What a truth shows to be wrong with itself, or with what it is compared with."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.app.truth import FoundJoints, Truth, match_frames
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.datasets import SurfaceTruth
from perfcap.io.doctor.body_size import body_size
from perfcap.io.doctor.doubled import examine_doubled
from perfcap.io.doctor.sparse import detected_period
from perfcap.io.doctor.straight import examine_straight
from perfcap.metrics import (
    counted_joints,
    mismatches,
    pixel_mismatches,
    surface_mismatches,
)

_FAR, _NEARER = 0.1, 0.5  # m off, and share of it that another person leaves
_TALL = 500.0  # px, of a person in the images for which interpolation is looked for
_AROUND, _MOST = 10, 200  # frames before and after those that are compared; and of a surface


def joint_doubts(found: FoundJoints, truth: Truth) -> list[str]:
    """Mistakes in the truth that its joints show; see ``mismatches``."""
    if truth.sequence.joints3d is None:
        return []
    rows, others = match_frames(found.frames, truth, str(found.path))
    estimate, true = found.joints[rows], truth.scored(truth.sequence.joints3d[others])
    valid = counted_joints(estimate, true, partial=True)
    if bool(valid.any()) and torch.equal(estimate[valid], true[valid]):
        return [
            f"{truth.sequence.folder}: has the joints of the result itself, to the last bit, so "
            "that nothing is measured; give the truth"
        ]
    nearer = list(_others(estimate, true, valid, truth, others))
    if nearer:
        return nearer
    numbers = found.frames[rows].tolist()
    order = LANDMARKS16.mirrored()
    told = mismatches(estimate, true, valid, order, frames=numbers, joints=LANDMARKS)
    return [*told, *_made_up(true, valid)]


def _others(
    estimate: Tensor, true: Tensor, valid: Tensor, truth: Truth, rows: list[int]
) -> Iterator[str]:
    """That another person of the recording is the one whom a result shows."""
    for name, joints in truth.sequence.others.items():
        other = truth.scored(joints[rows])
        both = valid & other.isfinite().all(-1)
        if 2 * int(both.sum()) < int(valid.sum()):
            continue
        own, left = (float((estimate - each)[both].norm(dim=-1).mean()) for each in (true, other))
        if own > _FAR and left < _NEARER * own:
            yield (
                f"{name} of the same recording is nearer to the result: {left / own:.0%} of the "
                f"error is left; --sequence {name} compares with that person"
            )


def _made_up(true: Tensor, valid: Tensor) -> Iterator[str]:
    """That joints of a truth are copies of others, or were put in between for some frames."""
    for copied in examine_doubled("", true, valid, true=True):
        yield (
            f"the truth: {copied.what}, and its error says nothing; give the places that were "
            "measured, or look at per_joint_mm alone"
        )
    size = body_size(true, valid)
    said = [finding.what for finding in examine_straight("", 0, true, valid, "its joints")]
    if not said and size is not None and (period := detected_period(_TALL * true / size, valid)):
        said = [f"one in {period} frames was measured, it seems, and the others lie on curves"]
    for what in said:
        yield (
            f"the truth: {what}; errors there are those of what was put in between, give what was "
            "measured in every frame"
        )


def image_doubts(found: FoundJoints, truth: Truth) -> list[str]:
    """That joints annotated in the images are not those that the cameras of the truth see."""
    sequence = truth.sequence
    if sequence.rig is None or sequence.pixels is None or sequence.joints3d is None:
        return []
    _, rows = match_frames(found.frames, truth, str(found.path))
    span = _span(rows, len(sequence.frames))
    joints = truth.scored(sequence.joints3d[span])
    seen = sequence.rig.cameras.frames(span).project(joints)
    order, names = LANDMARKS16.mirrored(), sequence.rig.names
    said = pixel_mismatches(seen, sequence.pixels[span], order, names)
    return [f"{sequence.folder}: {what}" for what in said]


def surface_doubts(true: SurfaceTruth, truth: Truth, rows: list[int]) -> list[str]:
    """That the true surface is not one of the true joints.

    Args:
        true: the surface.
        truth: what it belongs to, of which some frames are compared.
        rows: these.
    """
    joints = truth.sequence.joints3d
    if joints is None or not rows or len(joints) != len(true.vertices):
        return []
    span = _span(rows, len(joints))
    span = slice(span.start, min(span.stop, span.start + _MOST))
    found = surface_mismatches(torch.from_numpy(true.vertices[span].astype(float)), joints[span])
    return [f"{truth.sequence.folder}: {what}" for what in found]


def _span(rows: list[int], count: int) -> slice:
    return slice(max(min(rows) - _AROUND, 0), min(max(rows) + _AROUND + 1, count))
