"""Whether numbers are turns that are written so that their means are none of them."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from perfcap.errors import InputError

_HALF, _STEP = 2.6, 0.2  # rad, of vectors on both sides of half a turn, and of a frame's motion
_UNIT, _ROUNDING = 1e-3, 1e-4  # of a quaternion's length, of a turn


def require_no_turns(values: Tensor) -> None:
    """Refuse what goes on elsewhere though nothing turned: rotations, and angles, written so.

    Raises:
        InputError: vectors (F, ..., 3) go on a full turn farther, quaternions (F, ..., 4) change
            their sign, or angles theirs at half a turn.
    """
    before, after = values.detach()[:-1], values.detach()[1:]
    if not len(before):
        return
    last = values.shape[-1] if values.dim() > 1 else 0
    if last == 3 and _turned(before, after):
        raise InputError(
            "values are rotation vectors that go on a full turn farther, and whose means turn "
            "nowhere near; expected what may be averaged: use smooth_rotations, or a Smoother of "
            "mean_rotations"
        )
    if last == 4 and _negated(before, after):
        raise InputError(
            "values are quaternions that change their sign from one frame to the next, and whose "
            "means are none; expected what may be averaged: give quaternion_to_rotvec of them to "
            "smooth_rotations"
        )
    if any(_wrapped(before, after, turn) for turn in (math.tau, 360.0)):
        raise InputError(
            "values are angles that jump a full turn, from one half of it to the other, and whose "
            "means lie between; expected what may be averaged: give rotations to smooth_rotations, "
            "or unwrap the angles (numpy.unwrap)"
        )


def _turned(before: Tensor, after: Tensor) -> bool:
    """Whether rotation vectors (F, ..., 3) are followed by ones that turn the other way round."""
    size = before.norm(dim=-1, keepdim=True)
    turned = before - math.tau * before / size.clamp(min=_HALF)
    wraps = (size[..., 0] > _HALF) & (after.norm(dim=-1) > _HALF)
    wraps &= (after - turned).norm(dim=-1) < _STEP
    return bool(wraps.any())


def _negated(before: Tensor, after: Tensor) -> bool:
    """Whether unit quaternions (F, ..., 4) are followed by the negative of nearly the same."""
    unit = ((before.norm(dim=-1) - 1).abs() < _UNIT).all() & (
        (after.norm(dim=-1) - 1).abs() < _UNIT
    ).all()
    return bool(unit & ((before + after).norm(dim=-1) < _STEP).any())


def _wrapped(before: Tensor, after: Tensor, turn: float) -> bool:
    """Whether numbers (F, ...) go from one end of -turn / 2 to turn / 2 to the other."""
    ends = torch.minimum(before.abs(), after.abs()) > _HALF / math.tau * turn
    across = ((before - after).abs() - turn).abs() < _STEP / math.tau * turn
    # places may be anywhere, angles that are written so are never beyond
    within = torch.maximum(before.abs(), after.abs()).amax(0) <= (0.5 + _ROUNDING) * turn
    return bool((ends & across & within).any())
