"""Frames without an estimate: filled from their neighbours, and named."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.errors import InputError
from perfcap.geometry.rotation import (
    aligned,
    quaternion_to_rotvec,
    rotvec_to_quaternion,
)


def fill_gaps(motion: Motion, seen: Tensor) -> Motion:
    """Interpolate the frames (F,) that were not seen; ends hold the nearest seen pose.

    Raises:
        InputError: no frame was seen at all.
    """
    if bool(seen.all()):
        return motion
    require_somebody(seen)
    before, after, share = _neighbours(seen)
    share = share.to(motion.angles)[:, None]

    def between(values: Tensor) -> Tensor:
        return torch.where(
            seen[:, None], values, values[before] + share * (values[after] - values[before])
        )

    turned = rotvec_to_quaternion(motion.rotation)
    pair = aligned(torch.stack((turned[before], turned[after]), -2))
    mixed = torch.nn.functional.normalize(pair[:, 0] + share * (pair[:, 1] - pair[:, 0]), dim=-1)
    rotation = torch.where(seen[:, None], motion.rotation, quaternion_to_rotvec(mixed))
    return Motion(between(motion.translation), rotation, between(motion.angles), motion.shared)


def require_somebody(seen: Tensor) -> None:
    """Refuse a clip that shows the person in none of its frames (F,).

    Raises:
        InputError: it is such a clip.
    """
    if not bool(seen.any()):
        raise InputError(
            "detections show a person in no frame; expected at least 3 joints in one frame: check "
            "that they belong to this video and that confidences are above 0"
        )


def ranges(missing: Tensor) -> list[tuple[int, int]]:
    """Runs of true entries of (F,) as half-open frame ranges."""
    edges = torch.diff(torch.nn.functional.pad(missing.to(torch.int8), (1, 1)))
    starts, stops = torch.where(edges == 1)[0], torch.where(edges == -1)[0]
    return list(zip(starts.tolist(), stops.tolist(), strict=True))


def _neighbours(seen: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Nearest seen frame before and after each frame, and where between them it lies."""
    frames = torch.arange(len(seen), device=seen.device)
    before = torch.where(seen, frames, -1).cummax(0).values
    after = torch.where(seen, frames, len(seen)).flip(0).cummin(0).values.flip(0)
    first, last = frames[seen][0], frames[seen][-1]
    before, after = before.clamp(min=int(first)), after.clamp(max=int(last))
    share = (frames - before) / (after - before).clamp(min=1)
    return before, after, share.clamp(0, 1)
