"""Cameras that see a whole motion, on a stand or moved by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.render import look_at

_REACH = 0.82  # of the image, that the motion fills


@dataclass(frozen=True)
class Handling:
    """How a camera is moved.

    Attributes:
        name: of it.
        sway: deviation of its place about one axis, m.
        roam: of the point that it looks at, m.
        follows: share of the person's level way that it turns after.
        around: degrees by which it walks around the middle of the motion.
        roll: deviation, degrees.
    """

    name: str
    sway: float = 0.04
    roam: float = 0.06
    follows: float = 0.0
    around: float = 0.0
    roll: float = 1.0


HELD = Handling("held by hand")


def staged_camera(
    joints: Tensor, size: int, rng: np.random.Generator, handling: Handling | None, rate: float
) -> Camera:
    """A camera that sees the whole motion, on a stand or in a hand."""
    held = handling is not None
    points = joints.flatten(0, 1)
    centre = 0.5 * (points.amin(0) + points.amax(0))
    focal = float(rng.uniform(0.9, 1.6)) * size
    reach = float((points - centre).norm(dim=-1).max()) + 0.2
    distance = max(1.8, 2 * reach * focal / (_REACH * size))
    heading, tilt = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(0, 18))
    ray = [math.cos(tilt) * math.sin(heading), math.sin(tilt), math.cos(tilt) * math.cos(heading)]
    count = len(joints) if held else 1
    handling = handling or Handling("on a stand", sway=0, roam=0, roll=0)
    sway = handling.sway * shake(count, rng, rate) if held else torch.zeros(1, 3)
    roam = handling.roam * shake(count, rng, rate) if held else torch.zeros(1, 3)
    if handling.follows:
        level = mid_hip(joints) - mid_hip(joints).mean(0)
        roam = roam + handling.follows * level * level.new_tensor([1.0, 0.0, 1.0])
    turn = torch.zeros(count, 3)
    turn[:, 1] = math.radians(handling.around) * torch.linspace(-0.5, 0.5, count)
    eye = centre + distance * rotvec_to_matrix(turn) @ centre.new_tensor(ray) + sway
    eye[:, 1] = eye[:, 1].clamp(min=0.3)
    rotation, translation = look_at(eye, centre + roam, centre.new_tensor([[0.0, 1.0, 0.0]]))
    roll = torch.zeros(count, 3)
    roll[:, 2] = math.radians(handling.roll) * (shake(count, rng, rate)[:, 0] if held else 0.0)
    turn = rotvec_to_matrix(roll)
    rotation, translation = turn @ rotation, (turn @ translation[..., None]).squeeze(-1)
    middle = 0.5 * (size - 1)
    lens = centre.new_tensor([[focal, 0, middle], [0, focal, middle], [0, 0, 1]])
    parts = [lens.expand(count, 3, 3), rotation, translation]
    parts = [part.double()[:, None] if held else part.double() for part in parts]
    return Camera(parts[0], parts[1], parts[2], size=((size, size),))


def shake(count: int, rng: np.random.Generator, rate: float) -> Tensor:
    """A hand's motion along three axes, (F, 3), deviation about one."""
    time = np.arange(count)[:, None, None] / rate
    often = rng.uniform(0.2, 2.5, (1, 5, 3))
    size = rng.normal(size=(1, 5, 3)) / np.sqrt(often)
    waves = (size * np.sin(2 * np.pi * often * time + rng.uniform(0, 6.3, (1, 5, 3)))).sum(1)
    return torch.from_numpy(waves / np.sqrt(2.5)).float()
