"""Errors that are larger than those which the report of a capture expects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perfcap.app.truth import FoundJoints, Truth, match_frames
from perfcap.errors import InputError
from perfcap.geometry.alignment import procrustes, similarity_align
from perfcap.io.calibration import read_cameras
from perfcap.io.result import Expectation, read_expectation
from perfcap.metrics import counted_joints
from perfcap.metrics.alignment import body_axes
from perfcap.metrics.mismatch_named import Numbered, runs
from perfcap.metrics.mismatch_world import WorldNote

_FEWEST_JOINTS, _FEWEST = 6, 5  # of a frame, and frames
# Times the expected error, and mm more than it
_CHANGES = (1.6, 8.0)  # of what remains without the mean place of each joint in the body
_ALL = (1.8, 25.0)  # of all of it: programs place joints differently in the body
_IN_PART = (2.5, 25.0)  # of what changes, in ten frames
_PART = 10
_LARGER, _LARGER_PART = 1.1, 1.2  # than the person, in all frames and in ten of them
# m that several views are off by, and one across its sight: depth is open in one view
_PLACE, _ASIDE = 0.12, 0.12
# Times the error of joints, and mm more than it: garments and vertices along them go further
_SURFACES = {"surface_transl_mm": (1.0, 20.0), "vertex_transl_mm": (2.5, 30.0)}
_LOOK = (
    "the truth is of other frames, joints or people there, or the capture is wrong where its trust "
    "does not show it; look at both"
)


def expected_doubts(
    folder: Path, found: FoundJoints, truth: Truth, said: Sequence[str] = ()
) -> list[str]:
    """That the truth of a capture, or the capture, is wrong for a reason that is not known.

    Errors after a similarity of each frame are compared with those that its report expects, in
    frames that the report does not doubt. Places are not compared where the truth is of another
    world.

    Args:
        folder: of the capture.
        found: its joints.
        truth: what they are compared with.
        said: what is known to be wrong with it; nothing is added but to other worlds.
    """
    if not all(isinstance(each, WorldNote) for each in said):
        return []
    own, joints = read_expectation(folder), truth.sequence.joints3d
    if own is None or joints is None or len(own.error) != len(found.frames):
        return []
    rows, others = match_frames(found.frames, truth, str(found.path))
    estimate, true = found.joints[rows], truth.scored(joints[others])
    valid = counted_joints(estimate, true, partial=True)
    limit = torch.from_numpy(own.error)[rows]
    kept = (valid.sum(-1) >= _FEWEST_JOINTS) & limit.isfinite()
    if int(kept.sum()) < _FEWEST:
        return []
    pose, changing = _errors(estimate[kept], true[kept], valid[kept])
    frames = torch.from_numpy(found.frames)[rows][kept]
    named = Numbered(frames.tolist())
    estimate, true, valid = estimate[kept], true[kept], valid[kept]
    larger = list(_larger(pose, changing, limit[kept], named)) or list(
        _sized(procrustes(estimate, true, valid.to(estimate.dtype)).scale, named, not said)
    )
    return larger or ([] if said else list(_elsewhere(estimate, true, valid, own, frames)))


def surface_doubt(folder: Path, scores: Mapping[str, float]) -> list[str]:
    """That true surfaces are further from those of a capture than its joints can explain.

    Args:
        folder: of the capture, whose report counts where the truth has no joints.
        scores: errors by name, mm, of joints and surfaces.
    """
    usual, what = scores.get("mpjpe_transl_mm"), "true joints"
    own = read_expectation(folder) if usual is None else None
    if own is not None and np.isfinite(own.error).any():
        usual, what = float(np.nanmean(own.error)), "its report expects joints at"
    for name, (factor, more) in _SURFACES.items():
        error = scores.get(name)
        if usual is not None and error is not None and error > factor * usual + more:
            return [
                f"true surfaces are {error:.0f} mm from those of the capture ({name}), and {what} "
                f"{usual:.0f}; check that they are of the same person, frames and unit"
            ]
    return []


def _errors(estimate: Tensor, truth: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """After a similarity of each frame, and without the usual place of each joint, (F,) mm."""
    moved = similarity_align(estimate, truth, valid.to(estimate.dtype))
    apart = torch.where(valid[..., None], (moved - truth) @ body_axes(moved), torch.nan)
    usual = apart.nanmedian(0).values.nan_to_num()
    first, second = (1000 * each.norm(dim=-1).nanmean(-1) for each in (apart, apart - usual))
    return first, second


def _larger(pose: Tensor, changing: Tensor, expected: Tensor, named: Numbered) -> Iterator[str]:
    usual = float(expected.mean())
    checks = ((float(changing.mean()), _CHANGES), (float(pose.mean()), _ALL))
    if any(error > factor * usual and error > usual + more for error, (factor, more) in checks):
        yield (
            f"aligned frame by frame joints are {float(pose.mean()):.0f} mm off, and the report of "
            f"the capture expects {usual:.0f}; {_LOOK}"
        )
        return
    factor, more = _IN_PART
    wrong = torch.zeros(len(pose), dtype=torch.bool)
    for start in range(0, len(pose) - _PART + 1, _PART // 2):
        part = slice(start, start + _PART)
        error, limit = float(changing[part].mean()), float(expected[part].mean())
        wrong[part] |= error > factor * limit and error > limit + more
    for first, last in runs(wrong):
        part = slice(first, last + 1)
        yield (
            f"in {named.stretch(first, last)}, aligned frame by frame, joints are "
            f"{float(pose[part].mean()):.0f} mm off, and the report of the capture expects "
            f"{float(expected[part].mean()):.0f}; {_LOOK}"
        )


def _elsewhere(
    estimate: Tensor, truth: Tensor, valid: Tensor, own: Expectation, frames: Tensor
) -> Iterator[str]:
    """That the person of a truth is at another place than views saw."""
    way = torch.where(valid[..., None], truth - estimate, torch.nan).nanmean(1)
    if own.views > 1:
        far = float(way.norm(dim=-1).mean())
        if far > _PLACE:
            yield (
                f"the person of the truth is {far:.2f} m from that of the result, and several "
                "views saw it; check world, origin and unit of the truth, and the cameras"
            )
        return
    centre = _centre(own, frames)
    if centre is not None:
        middle = torch.where(valid[..., None], estimate, torch.nan).nanmean(1)
        sight = torch.nn.functional.normalize(middle - centre, dim=-1)
        aside = float((way - (way * sight).sum(-1, keepdim=True) * sight).norm(dim=-1).mean())
        if aside > _ASIDE:
            yield (
                f"the person of the truth is {aside:.2f} m beside that of the result as the camera "
                "sees both; check world, origin and unit of the truth, and the camera"
            )


def _sized(larger: Tensor, named: Numbered, parts: bool) -> Iterator[str]:
    """That a truth is larger than a result, by factors (F,), or in a part of the frames.

    Of one video without a calibration the pose may be so wrong for a while that its size is: parts
    are looked at where worlds are one.
    """
    usual = float(larger.median())
    if not 1 / _LARGER < usual < _LARGER:
        yield (
            f"the person of the truth is {usual:.2f} times as large as that of the result; check "
            "the unit of the truth, and the height of the actor"
        )
        return
    if not parts:
        return
    part = max(min(_PART, len(larger)), 1)
    around = larger.unfold(0, part, 1).median(-1).values
    wrong = torch.zeros(len(larger), dtype=torch.bool)
    for start in ((around > _LARGER_PART) | (around < 1 / _LARGER_PART)).nonzero()[:, 0].tolist():
        wrong[start : start + part] = True
    for first, last in runs(wrong):
        there = float(larger[first : last + 1].median())
        yield (
            f"in {named.stretch(first, last)} the person of the truth is {there:.2f} times as "
            f"large as that of the result, and {usual:.2f} times in all; check the unit of the "
            "truth there"
        )


def _centre(own: Expectation, frames: Tensor) -> Tensor | None:
    """Where the only camera of a capture stands, (3,) or (F, 3); None where that is not known."""
    if own.cameras is None:
        return None
    try:
        cameras = read_cameras(own.cameras).cameras
    except InputError:
        return None
    if cameras.views != 1 or (cameras.moving and len(cameras.rotation) <= int(frames.max())):
        return None
    return (cameras.frames(frames) if cameras.moving else cameras).centre[..., 0, :]
