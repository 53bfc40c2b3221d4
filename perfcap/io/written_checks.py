"""What a motion or a surface that is to be written shows of its units, frames and transforms."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.metrics.missing import PERSON
from perfcap.rates import rate_doubts

Floats = NDArray[np.float64]

_APART = 1e-3  # of the height: joints that hold together come nowhere near
SURFACE_APART = 0.025
"""Of the height, in the median: more than clothes are loose by, skirts included."""

_GLOBAL = 1.5  # times the usual length of bones: how far from parents no joint moves
_STRETCHED = 0.25  # of it: what hardly any joint comes nearer to its parent by
_FASTEST = 15.0  # m/s, of roots in the middle frame; no runner is
_LONGEST = 5.0  # m, of bones


def require_metres(block: NDArray[Any], name: str) -> None:
    """Refuse vertices (f, V, 3) whose first frame spans more than any person in metres.

    Raises:
        InputError: it does.
    """
    if block.ndim != 3 or not block.size:
        return
    span = float(np.ptp(block[0], axis=0).max())
    if span > PERSON:
        raise InputError(
            f"{name} spans {span:.4g} from end to end in a frame, expected metres; convert it"
        )


def frame_numbers(frames: NDArray[Any]) -> NDArray[np.int64]:
    """Numbers of frames (F,) as integers.

    Raises:
        InputError: some are no whole numbers, or do not rise.
    """
    given = np.asarray(frames)
    whole = given.astype(np.int64) if given.dtype.kind in "iuf" else None
    if whole is None or whole.ndim != 1 or (whole != given).any() or (np.diff(whole) <= 0).any():
        raise InputError(
            f"frames are {given.tolist()!r:.80}, expected the number of each frame in the video, "
            "rising"
        )
    return whole


def require_metric(offsets: Floats) -> None:
    """Refuse offsets of joints (J, 3), the root's first, of which one is longer than any bone.

    Raises:
        InputError: one is.
    """
    longest = float(np.linalg.norm(offsets[1:], axis=-1).max(initial=0.0))
    if longest > _LONGEST:
        raise InputError(
            f"offsets are up to {longest:.4g} long, expected metres; convert offsets and positions "
            "(metres_per_unit is the unit of the file alone)"
        )


def warn_of_rate(rate: float, level: int) -> None:
    """Warn of frames a second that look like the seconds of a frame, or of no recording."""
    for line in rate_doubts(rate):
        warnings.warn(line, stacklevel=level + 1)


def warn_of_transforms(template: Template, transforms: Floats, level: int) -> None:
    """Warn of bone transforms (F, B, 4, 4) under which a template comes apart at its joints.

    Rest-to-posed transforms of a bone and its parent take their joint to one place; those from the
    bone to the world, inverses, or those of another skeleton do not.
    """
    parents = template.bone_parents
    bones = np.flatnonzero(parents >= 0)
    joints = template.bone_rest[bones, :3, 3]
    own, above = (
        np.einsum("fbij,bj->fbi", each[..., :3, :3], joints) + each[..., :3, 3]
        for each in (transforms[:, bones], transforms[:, parents[bones]])
    )
    size = float(np.ptp(template.bone_rest[:, :3, 3], axis=0).max())
    if not len(bones) or not size > 0:
        return
    apart = np.median(np.linalg.norm(own - above, axis=-1), axis=0) / size
    if 2 * (apart > _APART).sum() > len(bones):
        warnings.warn(
            f"bone_transforms take {(apart > _APART).sum()} of {len(bones)} joints apart, by up to "
            f"{apart.max():.0%} of the skeleton: expected transforms from the rest pose to the "
            "posed one in metres, of this template (Performance.bone_transforms); those from bones "
            "to the world are these times template.bone_rest",
            stacklevel=level + 1,
        )


def warn_of_places(offsets: Floats, positions: Floats, frame_time: float, level: int) -> None:
    """Warn of joints' positions (F, J, 3) that are not those in their parents, or of another unit.

    Args:
        offsets: rest positions in the parent, (J, 3) m, the root's first.
        positions: in the parent, the root's in the world.
        frame_time: seconds between frames.
        level: of the caller who is warned.
    """
    lengths = np.linalg.norm(offsets[1:], axis=-1)
    usual = float(np.median(lengths)) if lengths.size else 0.0
    reach = np.linalg.norm(positions[:, 1:], axis=-1)  # (F, J - 1)
    stretched = np.ptp(reach, axis=0) > _STRETCHED * usual
    if usual and (2 * stretched.sum() > len(lengths) or np.median(reach) > _GLOBAL * usual):
        warnings.warn(
            f"positions lie {np.median(reach):.3g} m from their parents where bones are "
            f"{usual:.3g} m long, and {stretched.sum()} of {len(lengths)} come nearer and go "
            "farther: expected those in the parent's frame, in metres, not in the world",
            stacklevel=level + 1,
        )
    steps = np.linalg.norm(np.diff(positions[:, 0], axis=0), axis=-1)
    speed = float(np.median(steps)) / frame_time if len(steps) else 0.0
    if speed > _FASTEST:
        warnings.warn(
            f"the root moves at {speed:.4g} m/s: expected positions in metres and frame_time in "
            "seconds",
            stacklevel=level + 1,
        )


def warn_of_surface(apart: Floats, level: int) -> None:
    """Warn of a surface that lies elsewhere than the motion moves its skin to.

    Args:
        apart: how far vertices lie from the skin in the median, (F,), shares of the height.
        level: of the caller who is warned.
    """
    far = apart > SURFACE_APART
    if 2 * far.sum() > len(apart):
        warnings.warn(
            f"surface is not that of the motion: {far.sum()} of {len(apart)} frames are up to "
            f"{apart.max():.0%} of the person's height from it; give the same frames of both, in "
            "one world",
            stacklevel=level + 1,
        )
