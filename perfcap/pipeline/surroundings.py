"""Where up, ahead, the ground and the light are around a captured person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.pipeline.surface import BLOCK, SurfaceFrames
from perfcap.render import DAYLIGHT, Lighting

_HEAD = LANDMARKS.index("head_top")
_ANKLES = [LANDMARKS.index(name) for name in ("l_ankle", "r_ankle")]
_HIPS = [LANDMARKS.index(name) for name in ("l_hip", "r_hip")]
_GROUND = 0.3  # quantile over frames of the lowest vertex: feet sink in rather than float
_LOOKED_AT = 200  # frames at most


@dataclass(frozen=True)
class Surroundings:
    """Directions are unit vectors (3,) in the world.

    Attributes:
        up: against gravity.
        ahead: where the person looks at first, level.
        ground: height of the ground along ``up``, m.
    """

    up: Tensor
    ahead: Tensor
    ground: float

    @classmethod
    def around(
        cls,
        joints: Tensor,
        surface: SurfaceFrames,
        up: Tensor | None = None,
        shown: slice = slice(None),
    ) -> Self:
        """Up, ahead and ground around a captured person.

        Args:
            joints: landmarks, (F, 16, 3) m.
            surface: vertices of the F frames.
            up: known direction; the axis along which the person stands if None.
            shown: consecutive frames that matter: the ground is the one under these.
        """
        up = upright(joints) if up is None else up.to(joints)
        first, stop, _ = shown.indices(surface.frames)
        step = BLOCK * max(1, (stop - first) // _LOOKED_AT)
        lowest = [
            (surface[start : min(start + BLOCK, stop)].to(joints) @ up).amin(-1)
            for start in range(first, stop, step)
        ]
        ground = torch.quantile(torch.cat(lowest), _GROUND)
        return cls(up, facing(joints[first], up), float(ground))

    @property
    def lighting(self) -> Lighting:
        """Daylight from ahead of the person."""
        return daylight(self.up, self.ahead)


def upright(joints: Tensor, level: bool = False) -> Tensor:
    """The world axis, or its opposite, along which a person stands on average, (3,).

    Calibrations have y or z up, or y down as images do; files rarely say which.

    Args:
        joints: landmarks, (F, 16, 3).
        level: whether y is known to be up, whatever the person does.
    """
    if level:
        return axis("y").to(joints)
    return upright_axis((joints[:, _HEAD] - joints[:, _ANKLES].mean(1)).mean(0))


def upright_axis(direction: Tensor) -> Tensor:
    """The world axis, or its opposite, that is nearest to a direction (3,), (3,)."""
    along = direction.abs().argmax()
    up = torch.zeros_like(direction)
    up[along] = torch.sign(direction[along]) if direction[along] != 0 else 1.0
    return up


def shared_up(people: Sequence[Tensor], ups: Sequence[Tensor]) -> int:
    """Which of some directions is up for people of one world: all of them end below at one height.

    Where one of two people lies, the axis of that body is not up: along it they are side by side,
    and who walks does not stay at one height.

    Args:
        people: landmarks, (F, 16, 3) each.
        ups: unit vectors, (3,) each.
    """
    if len(people) < 2:
        return 0
    apart = []
    for up in ups:
        lowest = torch.cat([(joints @ up.to(joints)).amin(-1) for joints in people])
        apart.append(float((lowest - lowest.median()).abs().mean()))
    return apart.index(min(apart))


def upright_together(people: Sequence[Tensor]) -> Tensor:
    """The world axis, or its opposite, along which the people of one world stand, (3,).

    Args:
        people: landmarks, (F, 16, 3) each.
    """
    axes = [upright(joints) for joints in people]
    return axes[shared_up(people, axes)]


def up_doubt(up: Tensor, found: Tensor) -> str:
    """How the person bears themselves where an axis (3,) that was chosen is up, in words.

    Args:
        up: as it was chosen.
        found: along which the person stands, of ``upright``.

    Returns:
        A sentence; empty where the person stands upright.
    """
    along = float(up @ found)
    if along < -0.5:
        return "the person is upside down then; auto takes the opposite axis"
    if along < 0.5:
        place = int(found.abs().argmax())
        name = ("-" if float(found[place]) < 0 else "") + "xyz"[place]
        return f"the person lies then, in most frames; auto takes {name}"
    return ""


def facing(joints: Tensor, up: Tensor) -> Tensor:
    """Level direction (3,) that a person of landmarks (16, 3) faces."""
    left = joints[_HIPS[0]] - joints[_HIPS[1]]
    ahead = torch.linalg.cross(left, up)
    if not float(ahead.norm()) > 1e-6:  # lying on a side: any level direction
        ahead = torch.linalg.cross(torch.nn.functional.one_hot(up.abs().argmin(), 3).to(up), up)
    return torch.nn.functional.normalize(ahead, dim=0)


def daylight(up: Tensor, ahead: Tensor | None = None) -> Lighting:
    """The usual light, with its sun above and to the left of what is ``ahead``."""
    if ahead is None:
        ahead = facing(torch.zeros(len(LANDMARKS), 3).to(up), up)
    side = torch.linalg.cross(up, ahead)
    across, over, along = DAYLIGHT.towards_sun
    sun = (across * side + over * up + along * ahead).tolist()
    return replace(DAYLIGHT, towards_sun=(sun[0], sun[1], sun[2]), up=_triple(up))


def axis(name: str) -> Tensor:
    """A direction by name, such as ``y`` or ``-z``, (3,) float64.

    Raises:
        InputError: another name.
    """
    letter = name.removeprefix("-").removeprefix("+")
    if letter not in ("x", "y", "z") or len(name) > 2:
        raise InputError(f"--up {name}: expected x, y, z, or one of them with a minus sign")
    direction = torch.zeros(3, dtype=torch.float64)
    direction["xyz".index(letter)] = -1.0 if name.startswith("-") else 1.0
    return direction


def _triple(direction: Tensor) -> tuple[float, float, float]:
    x, y, z = direction.tolist()
    return x, y, z
