"""A compact network that finds 2D joints and 3D positions in the crop of one person."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn

from perfcap.detect.joint_set import LANDMARKS
from perfcap.train.body_parts import PARTS
from perfcap.train.config import DetectorConfig

JOINTS = len(LANDMARKS)
_MAPS = 4 * JOINTS  # heat, X, Y and Z of each joint
_FINER = 2  # map pixels along one of the finest features


class Guesses(NamedTuple):
    """What a detector is taught by; the last two are not exported.

    Heat maps alone learn late which side is which: until then both sides are half right.
    """

    logits: Tensor
    """Of the heat maps, (N, 16, H/4, W/4)."""
    places: Tensor
    """Location maps, (N, 3, 16, H/4, W/4) m."""
    pose: Tensor
    """The whole pose, of the whole crop, (N, 16, 3) m."""
    parts: Tensor
    """Logits of the parts of the body and the background, (N, 19, H/4, W/4)."""


class Detector(nn.Module):
    """Heat maps and location maps of 16 landmarks, at a quarter of the crop's resolution.

    Residual stages (He et al. 2016) down to a 32nd of the crop, two steps up again with what the
    way down saw, and maps whose X, Y and Z are read where the joint is (Mehta et al. 2017). Most
    work is done on small features: a crop of 256 pixels costs 0.3 billion products.
    """

    def __init__(self, config: DetectorConfig | None = None) -> None:
        super().__init__()
        self.config = config or DetectorConfig()
        stem, *widths = self.config.widths
        self.register_buffer("mean", torch.tensor([118.0, 112.0, 108.0]).reshape(3, 1, 1))
        # small steps at first: which side is which shows in faces and feet of a few pixels
        self.stem = nn.Sequential(
            _convolution(3, 16, 3, 2), _convolution(16, stem, 3, 2), _Block(stem, stem)
        )
        steps = zip(pairwise((stem, *widths)), self.config.blocks, strict=True)
        self.down = nn.ModuleList(_stage(a, b, count) for (a, b), count in steps)
        back = list(pairwise(reversed(widths)))
        self.narrow = nn.ModuleList(nn.Conv2d(a, b, 1) for a, b in back)
        self.up = nn.ModuleList(_Block(b, b) for _, b in back)
        self.maps = nn.Conv2d(widths[0], _MAPS * _FINER**2, 1)
        self.parts = nn.Conv2d(widths[0], len(PARTS) * _FINER**2, 1)
        self.pose = nn.Linear(widths[-1], 3 * JOINTS)

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor]:
        """Maps of crops.

        Args:
            crops: (N, 3, H, W), RGB, 0 to 255; H and W multiples of 32.

        Returns:
            Logits of the heat maps (N, 16, H/4, W/4), and the maps of X, Y and Z
            (N, 3, 16, H/4, W/4), metres about the middle of the hips, in axes whose z is the ray
            through the middle of the crop.
        """
        return self._maps(self._up(self._down(crops)))

    def guess(self, crops: Tensor) -> Guesses:
        """The same, and what else there is to learn from."""
        seen = self._down(crops)
        fine = self._up(seen)
        pose = self.pose(seen[-1].mean((-2, -1))).reshape(-1, JOINTS, 3)
        parts = nn.functional.pixel_shuffle(self.parts(fine), _FINER)
        return Guesses(*self._maps(fine), pose, parts)

    def _down(self, crops: Tensor) -> list[Tensor]:
        features = self.stem((crops - cast(Tensor, self.mean)) / 64.0)
        seen = []
        for stage in self.down:
            features = stage(features)
            seen.append(features)
        return seen

    def _up(self, seen: list[Tensor]) -> Tensor:
        features = seen[-1]
        for narrow, block, skip in zip(self.narrow, self.up, reversed(seen[:-1]), strict=True):
            coarse = nn.functional.interpolate(narrow(features), scale_factor=2.0, mode="nearest")
            features = block(torch.relu(skip + coarse))
        return features

    def _maps(self, features: Tensor) -> tuple[Tensor, Tensor]:
        maps = nn.functional.pixel_shuffle(self.maps(features), _FINER)
        places = maps[:, JOINTS:].reshape(-1, 3, JOINTS, *maps.shape[-2:])
        return maps[:, :JOINTS], places


class DetectorMaps(nn.Module):
    """What is exported: heat maps that sum to one, and the maps of X, Y and Z."""

    def __init__(self, detector: Detector) -> None:
        super().__init__()
        self.detector = detector

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Four times (N, 16, h, w)."""
        logits, places = self.detector(crops)
        heat = logits.flatten(2).softmax(-1).reshape(logits.shape)
        x, y, z = places.unbind(1)
        return heat, x, y, z


class _Block(nn.Module):
    """Two convolutions around a residual."""

    def __init__(self, before: int, after: int, step: int = 1) -> None:
        super().__init__()
        self.first = _convolution(before, after, 3, step)
        self.second = nn.Sequential(
            nn.Conv2d(after, after, 3, 1, 1, bias=False), nn.BatchNorm2d(after)
        )
        nn.init.zeros_(cast(nn.BatchNorm2d, self.second[1]).weight)  # the identity at first
        self.skip = (
            nn.Identity()
            if step == 1 and before == after
            else nn.Sequential(nn.Conv2d(before, after, 1, step, bias=False), nn.BatchNorm2d(after))
        )

    def forward(self, features: Tensor) -> Tensor:
        """(N, before, h, w) to (N, after, h / step, w / step)."""
        return torch.relu(self.second(self.first(features)) + self.skip(features))


def _stage(before: int, after: int, blocks: int) -> nn.Sequential:
    rest = (_Block(after, after) for _ in range(blocks - 1))
    return nn.Sequential(_Block(before, after, 2), *rest)


def _convolution(before: int, after: int, side: int, step: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, after, side, step, side // 2, bias=False),
        nn.BatchNorm2d(after),
        nn.ReLU(inplace=True),
    )
