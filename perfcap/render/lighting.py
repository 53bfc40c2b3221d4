"""Lights of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.errors import InputError

_BRIGHTEST = 20.0  # of a light; in bytes, a dim one has more

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Lighting:
    """Light in the world; intensities are linear RGB, and 1 in sum shows a texture as it is.

    Attributes:
        ambient: the same from everywhere, and never blocked.
        sky: on surfaces facing up, half of it on vertical ones, none on those facing down.
        sun: on surfaces facing the sun.
        towards_sun: direction, any length.
        up: direction, any length.
    """

    ambient: Color = (0.12, 0.12, 0.13)
    sky: Color = (0.46, 0.48, 0.52)
    sun: Color = (0.72, 0.68, 0.60)
    towards_sun: Color = (0.5, 1.0, 0.6)
    up: Color = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("ambient", "sky", "sun"):
            color = getattr(self, name)
            if len(color) != 3 or not all(0 <= light <= _BRIGHTEST for light in color):
                raise InputError(
                    f"{name} of Lighting is {color!r:.80}, expected three numbers of linear light, "
                    f"from 0 to {_BRIGHTEST:g}, of which 1 in sum shows a texture as it is: divide "
                    "bytes by 255"
                )
        for name in ("towards_sun", "up"):
            way = getattr(self, name)
            if len(way) != 3 or not 0 < sum(each * each for each in way) < math.inf:
                raise InputError(f"{name} of Lighting is {way!r:.80}, expected a direction x, y, z")

    def table(self) -> Tensor:
        """Ambient, sky, sun, and the unit directions to the sun and up, (5, 3) float32."""
        colors = torch.tensor([self.ambient, self.sky, self.sun])
        directions = [unit(each, colors) for each in (self.towards_sun, self.up)]
        return torch.cat([colors, torch.stack(directions)])

    def parts(self, normals: Tensor) -> tuple[Tensor, Tensor]:
        """Irradiance of the sun and of the sky, (N, 3) each, on surfaces of normals (N, 3)."""
        facing_sun = (normals @ unit(self.towards_sun, normals)).clamp_min(0)
        facing_up = 0.5 + 0.5 * normals @ unit(self.up, normals)
        sun, sky = normals.new_tensor(self.sun), normals.new_tensor(self.sky)
        return sun * facing_sun[:, None], sky * facing_up[:, None]

    def on(self, normals: Tensor) -> Tensor:
        """Irradiance (N, 3) on surfaces of unit normals (N, 3) that see every light."""
        sun, sky = self.parts(normals)
        return normals.new_tensor(self.ambient) + sun + sky


DAYLIGHT = Lighting()
FLAT = Lighting(ambient=(1.0, 1.0, 1.0), sky=(0.0, 0.0, 0.0), sun=(0.0, 0.0, 0.0))


def unit(direction: Color, like: Tensor) -> Tensor:
    """A direction as a unit vector (3,) of a tensor's kind."""
    return torch.nn.functional.normalize(like.new_tensor(direction), dim=0)
