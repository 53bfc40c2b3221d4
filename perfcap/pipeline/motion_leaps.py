"""Turns and leaps that no person makes, as where angles were smoothed across +-180 degrees."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.io.doctor.finding import ranges
from perfcap.io.doctor.leaps import LEAP, LEAPING, leaping
from perfcap.pipeline.joint_motion import unit_vectors

# Seconds, degrees that hips and shoulders turn in so many, and at most in as many before and after:
# dancers turn once in half a second, and skaters who are faster go on
_INSTANT, _SPUN, _CALM = 0.2, 270.0, 90.0
_FEWEST = 2  # frames of an instant
# Frames in which joints leap; frames a second from which on fast limbs change their way by less;
# and degrees that the trunk turns in the seconds about a frame: of who spins on, hands leap as well
_SOME, _OFTEN = 3, 24.0
_ON, _SECONDS = 720.0, 1.3
_AT_ONCE, _SPIN = 60.0, 2400.0  # degrees a frame, and a second: who skates spins by 2050 a second
_SMOOTHED = (
    "were angles smoothed, filtered or resampled across +-180 degrees, or markers lost? Unwrap "
    "angles first, or turn to rotations, and leave such frames out"
)


def smoothing_doubts(position: Tensor, rate: float) -> Iterator[str]:
    """A sentence about frames in which limbs, or else the trunk, go the long way round.

    Args:
        position: of joints in the world, (F, 16, 3) metres.
        rate: frames a second.
    """
    joints = position.detach().double().cpu()
    if frames := _leaps(joints, rate):
        yield (
            f"joints leap by {LEAP} m or more there and back in frames {ranges(frames)} (counted "
            f"from 0): {_SMOOTHED}"
        )
    elif frames := _spins(joints, rate):
        yield (
            f"the person turns once about within {_INSTANT:g} s in frames {ranges(frames)} "
            f"(counted from 0), and hardly before and after: {_SMOOTHED}"
        )


def _leaps(joints: Tensor, rate: float) -> list[int]:
    """Frames in which joints (F, 16, 3) leap while the person does not spin on, if enough do."""
    if rate < _OFTEN:
        return []
    total, reach = _turned(joints), round(0.5 * _SECONDS * rate)
    index = torch.arange(len(joints))
    about = total[(index + reach).clamp(max=len(joints) - 1)] - total[(index - reach).clamp(min=0)]
    frames: list[int] = (leaping(joints) & (about < _ON)).nonzero()[:, 0].tolist()
    return frames if len(frames) >= max(_SOME, LEAPING * len(joints)) else []


def _spins(joints: Tensor, rate: float) -> list[int]:
    """Frames in which the trunk goes round once where it hardly turns otherwise, of (F, 16, 3)."""
    length = max(_FEWEST, round(_INSTANT * rate))
    if len(joints) < 3 * length + 1:
        return []
    total = _turned(joints)
    sums = total[length:] - total[:-length]  # degrees from each frame on, over an instant
    spun = sums[length:-length] >= _SPUN
    calm = torch.maximum(sums[: -2 * length], sums[2 * length :]) <= _CALM
    starts = ((spun & calm).nonzero()[:, 0] + length).tolist()
    return sorted({frame for start in starts for frame in range(start, start + length)})


def _turned(joints: Tensor) -> Tensor:
    """By how much the lines of hips and shoulders both have turned up to each frame, degrees."""
    turns = []
    for name in ("hip", "shoulder"):
        left, right = (JOINTS.index(f"{side}_{name}") for side in "lr")
        line = unit_vectors(joints[:, left] - joints[:, right])
        turns.append((line[1:] * line[:-1]).sum(-1).clamp(-1, 1).arccos().rad2deg())
    both = torch.minimum(*turns)
    return torch.cat((both.new_zeros(1), both.cumsum(0)))


def turn_doubts(rotation: Tensor, rate: float, frames: Sequence[int]) -> Iterator[str]:
    """Frames in which the whole person turns at once as nobody does.

    Args:
        rotation: of the root, (F, 3) rotation vectors, radians.
        rate: frames a second.
        frames: their numbers, F.
    """
    turn = rotvec_to_matrix(rotation)
    angle = matrix_to_rotvec(turn[:-1].mT @ turn[1:]).norm(dim=-1).rad2deg()
    at_once = ((angle > _AT_ONCE) & (angle * rate > _SPIN)).nonzero().flatten().tolist()
    if at_once:
        where = ranges([frames[frame + 1] for frame in at_once])
        yield (
            f"the person turns by up to {float(angle.max()):.0f} degrees within a frame (frames "
            f"{where}); check the source's rotations there, and whether takes were joined or its "
            "first frame is a rest pose (--frames 1:)"
        )
