"""Whether a person moves enough to compare the clocks of views by, and when they move most."""

from __future__ import annotations

import torch

from perfcap.detect.detections import Detections
from perfcap.errors import InputError

_BLOCK = 0.27  # s
_LIVELY = 2.5  # steps between blocks, in deviations within one; see ``_liveliness``
_SURE = 0.3  # confidence


def least_frames(rate: float) -> int:
    """Frames of the shortest clip that says whether a person moves: two blocks, at a rate in Hz."""
    return 2 * _block(rate)


def require_motion(detections: Detections, rate: float) -> None:
    """Refuse to tell clocks by somebody who stands still.

    Args:
        detections: (F, C, 16), of ``least_frames`` or more: a single block has no step to another.
        rate: frames a second.

    Raises:
        InputError: what moves is no more than errors of a detector.
    """
    views = [_liveliness(detections.select([view]), rate) for view in range(detections.views)]
    if float(torch.tensor(views).median()) < _LIVELY:
        raise InputError(
            "the person hardly moves, which says nothing about clocks; give a part of the clip "
            "with motion (--frames), or synchronous views"
        )


def _liveliness(detections: Detections, rate: float) -> float:
    """Steps of a view's joints from one short block of frames to the next, in deviations within.

    Errors of a detector that stay alike for 8 frames make 0.5 to 2.3 of somebody who stands,
    people who walk, dance or balance 3.4 to 6 in the median of the views.
    """
    length = _block(rate)
    seen = (detections.confidence2d[:, 0] > _SURE).unfold(0, length, length).all(-1)  # N 16
    paths = detections.joints2d[:, 0].unfold(0, length, length)  # N 16 2 L
    steps = paths.mean(-1).diff(dim=0)[seen[1:] & seen[:-1]]
    within = paths.var(-1)[seen]
    if not len(steps):
        return 0.0
    return float(steps.square().mean().sqrt() / within.median().sqrt().clamp(min=1e-9))


def _block(rate: float) -> int:
    return max(2, round(_BLOCK * rate))


def liveliest(detections: Detections, frames: int) -> slice:
    """The stretch in which joints move most in the images."""
    count = detections.frame_count
    if count <= frames:
        return slice(0, count)
    seen = detections.confidence2d
    both = torch.minimum(seen[1:], seen[:-1])
    moved = (both * detections.joints2d.diff(dim=0).norm(dim=-1)).flatten(1).median(-1).values
    start = int(moved.unfold(0, frames - 1, 1).mean(-1).argmax())
    return slice(start, start + frames)
