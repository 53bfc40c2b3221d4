"""Made-up networks for tests of following: one that looks up close, one that finds people."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.crop import Crop
from perfcap.detect.decode import Estimate
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16, JointSet
from perfcap.detect.look import Look
from perfcap.detect.search import whole

SIDE = 96
PLACES = torch.tensor(  # of a standing body, one high, head up
    [
        *((0.0, 0.0), (0.0, 0.2), (-0.15, 0.22), (-0.2, 0.4), (-0.2, 0.55)),
        *((0.15, 0.22), (0.2, 0.4), (0.2, 0.55), (-0.1, 0.5), (-0.1, 0.75), (-0.1, 0.95)),
        *((-0.15, 1.0), (0.1, 0.5), (0.1, 0.75), (0.1, 0.95), (0.15, 1.0)),
    ]
)


def draw(*people: tuple[float, float, float, float]) -> NDArray[np.uint8]:
    """A frame with people of (x, y, height, degrees that they are turned): a value for each joint,
    in red, and how sure one may be of them in green."""
    frame = np.zeros((240, 320, 3), np.uint8)
    for number, (x, y, height, degrees) in enumerate(people):
        angle = np.radians(degrees)
        turn = torch.tensor([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        points = height * (PLACES - torch.tensor([0.0, 0.5])) @ turn.T.float()
        for joint, (px, py) in enumerate(points.tolist()):
            px, py = round(px + x), round(py + y)
            frame[py - 3 : py + 4, px - 3 : px + 4] = (10 * joint + 50, 255 - 80 * number, 0)
    return frame


@dataclass
class Eyes:
    """Finds dots by their value, and believes in those of people whose head is up."""

    turns: str
    joint_set: JointSet = LANDMARKS16
    surest: float = 1.0
    blind: tuple[str, ...] = ()
    crops: int = 0
    manifest: Any = field(init=False)

    def __post_init__(self) -> None:
        spec = SimpleNamespace(size=(SIDE, SIDE), padding=1.2, turns=self.turns)
        self.manifest = SimpleNamespace(
            input=spec, output=SimpleNamespace(kind="coordinates", crop_axes=False, error3d=None)
        )

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        self.crops += len(crops)
        found = [self._one(crop.astype(float)) for crop in crops]
        points, trust = (torch.stack(each) for each in zip(*found, strict=True))
        return Estimate(points, trust, None)

    def _one(self, crop: NDArray[np.float64]) -> tuple[torch.Tensor, torch.Tensor]:
        points, trust = torch.zeros(16, 2), torch.zeros(16)
        strongest = max(crop[..., 1].max(), 1.0)
        mine = crop[..., 1] > strongest - 60
        for joint, name in enumerate(LANDMARKS):
            value = crop[..., 0] * strongest / np.maximum(crop[..., 1], 1)
            near = mine & (np.abs(value - (10 * joint + 50)) < 4)
            if near.any() and name not in self.blind:
                rows, columns = np.nonzero(near)
                points[joint] = torch.tensor([columns.mean(), rows.mean()]).float()
                trust[joint] = self.surest * strongest / 255
        upright = points[0, 1] < points[8, 1] - 10 and trust[[0, 8]].all()
        return points, trust * (1.0 if upright else 0.35)


def errors(found: torch.Tensor, x: float, y: float, height: float, degrees: float) -> torch.Tensor:
    angle = np.radians(degrees)
    turn = torch.tensor([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    truth = height * (PLACES - torch.tensor([0.0, 0.5])) @ turn.T.float() + torch.tensor([x, y])
    return (found - truth).norm(dim=-1)


@dataclass
class Glance:
    """Finds people where it is said that they are, joints with errors.

    Attributes:
        people: x, y and height of each.
        frames: that it was asked about.
    """

    people: tuple[tuple[float, float, float], ...]
    joint_set: JointSet = LANDMARKS16
    frames: int = 0

    def __call__(self, frame: NDArray[np.uint8]) -> list[Look]:
        self.frames += 1
        random, found = torch.Generator().manual_seed(0), []
        for x, y, height in self.people:
            off = 0.03 * torch.randn(16, 2, generator=random)
            points = height * (PLACES - torch.tensor([0.0, 0.5]) + off) + torch.tensor([x, y])
            crop = Crop.around(whole(frame), (SIDE, SIDE))
            found.append(Look(crop, points, torch.full((16,), 0.5), None, None))
        return found
