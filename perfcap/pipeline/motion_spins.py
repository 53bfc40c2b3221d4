"""Whether a motion spins for an instant, as where angles were smoothed across +-180 degrees."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.io.doctor.finding import ranges
from perfcap.pipeline.joint_motion import unit_vectors

# Seconds, degrees that hips and shoulders turn in so many, and at most in as many before and after:
# dancers turn once in half a second, and skaters who are faster go on
_INSTANT, _SPUN, _CALM = 0.2, 270.0, 90.0
_FEWEST = 2  # frames of an instant


def spin_doubts(position: Tensor, rate: float) -> Iterator[str]:
    """A sentence about frames in which the trunk goes round once where it hardly turns otherwise.

    Args:
        position: of joints in the world, (F, 16, 3) metres.
        rate: frames a second.
    """
    joints = position.detach().double().cpu()
    length = max(_FEWEST, round(_INSTANT * rate))
    if len(joints) < 3 * length + 1:
        return
    turned = torch.stack([_turns(joints, name) for name in ("hip", "shoulder")]).amin(0)
    total = torch.cat((turned.new_zeros(1), turned.cumsum(0)))
    sums = total[length:] - total[:-length]  # degrees from each frame on, over an instant
    spun = sums[length:-length] >= _SPUN
    calm = torch.maximum(sums[: -2 * length], sums[2 * length :]) <= _CALM
    starts = (spun & calm).nonzero()[:, 0] + length
    frames = sorted({frame for start in starts.tolist() for frame in range(start, start + length)})
    if frames:
        yield (
            f"the person turns once about within {_INSTANT:g} s in frames {ranges(frames)} "
            "(counted from 0), and hardly before and after: were angles smoothed, filtered or "
            "resampled across +-180 degrees? Unwrap them first, or do so with rotations"
        )


def _turns(joints: Tensor, name: str) -> Tensor:
    """By how much the line of a pair of joints turns from each frame to the next, degrees."""
    left, right = (JOINTS.index(f"{side}_{name}") for side in "lr")
    line = unit_vectors(joints[:, left] - joints[:, right])
    turned: Tensor = (line[1:] * line[:-1]).sum(-1).clamp(-1, 1).arccos().rad2deg()
    return turned
