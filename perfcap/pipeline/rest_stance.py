"""How a rest pose stands: which way it faces, and whether the whole body leans."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor

# Less is where joints were put: trunks alone lean by up to 10 degrees in skeletons of recordings,
# and shoulders of a fighting stance face elsewhere than its hips.
_FACING, _LEANING = math.radians(3), math.radians(8)


def upright_turn(at: Mapping[str, Tensor]) -> Tensor:
    """The turn that makes a body at rest stand along y and face +z, (3, 3).

    The identity where it does: where hips and shoulders do not face the same other way, and trunk
    and legs do not lean the same way.

    Args:
        at: rest positions (3,) of hips, shoulders, neck and ankles, metres, y up.
    """
    hips, shoulders = (at[f"l_{name}"] - at[f"r_{name}"] for name in ("hip", "shoulder"))
    middle = 0.5 * (at["l_hip"] + at["r_hip"])
    trunk = _unit(at["neck"] - middle)
    legs = _unit(middle - 0.5 * (at["l_ankle"] + at["r_ankle"]))
    y, left = torch.eye(3).to(trunk)[[1, 0]]
    up = y
    if min(_lean(trunk), _lean(legs)) > _LEANING and _same_way(trunk, legs):
        up = _unit(trunk + legs)
    upright = _least(up, y)
    facing = [_heading(upright @ across) for across in (hips, shoulders)]
    turn = 0.0
    if min(facing) > _FACING or max(facing) < -_FACING:
        turn = _heading(upright @ (_unit(hips) + _unit(shoulders)))
    across = math.cos(turn) * left - math.sin(turn) * torch.linalg.cross(left, y)
    facing_ahead = torch.stack((across, y, torch.linalg.cross(across, y)))
    return facing_ahead @ upright


def _unit(vector: Tensor) -> Tensor:
    unit: Tensor = vector / vector.norm().clamp(min=1e-9)
    return unit


def _lean(along: Tensor) -> float:
    return math.atan2(math.hypot(float(along[0]), float(along[2])), float(along[1]))


def _same_way(one: Tensor, other: Tensor) -> bool:
    """Whether both lean to the same side, and neither more than twice as far."""
    a, b = one[[0, 2]], other[[0, 2]]
    return float(a @ b) > 0.5 * max(float(a @ a), float(b @ b))


def _heading(across: Tensor) -> float:
    """Angle about y of what points to the left, radians; 0 where the body faces +z."""
    return math.atan2(-float(across[2]), float(across[0]))


def _least(one: Tensor, other: Tensor) -> Tensor:
    """The smallest rotation (3, 3) that takes a unit vector to another one, not its opposite."""
    total = one + other
    square = 2 * torch.outer(total, total) / (total @ total)
    turn: Tensor = square - torch.eye(3).to(one)  # half a turn about the middle, after ...
    return turn @ (2 * torch.outer(one, one) - torch.eye(3).to(one))  # ... one about the first
