"""What one frame shows of a person who is followed: silhouettes, and texture that moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.surface_points import LimbPoints
from perfcap.energy.line_distance import line_through
from perfcap.geometry.camera import Camera
from perfcap.segment import Contour

Mask = NDArray[np.bool_]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Texture:
    """Points of a person that were seen in the frame before and are again.

    Attributes:
        places: of the points at rest, (N, 3) m.
        joints: that each is rigid with, (N,).
        view: (N,).
        pixels: where they are now, (N, 2) px.
    """

    places: Tensor
    joints: Tensor
    view: Tensor
    pixels: Tensor

    def __len__(self) -> int:
        return len(self.view)

    def __getitem__(self, chosen: Tensor) -> Texture:
        parts = self.places, self.joints, self.view, self.pixels
        return Texture(*(each[chosen] for each in parts))

    def misses(self, actor: Actor, cameras: Camera, motion: Motion) -> Tensor:
        """How far from where they are seen a pose (1,) puts them, (N,) px."""
        with torch.no_grad():
            points = LimbPoints(actor, self.places, self.joints)(motion)
            shown = cameras.project_camera(cameras.to_camera(points))[0]  # C N 2
        own = shown[self.view, torch.arange(len(self.view))]
        missed: Tensor = (own - self.pixels).norm(dim=-1)
        return missed

    def lines(self, cameras: Camera) -> Tensor:
        """Direction and moment of the rays they are seen along, (N, 6)."""
        lines = self.places.new_empty(len(self.view), 6)
        for view in range(cameras.views):
            own = self.view == view
            lines[own] = pixel_lines(cameras.select([view]), self.pixels[own])
        return lines


@dataclass(frozen=True, eq=False)
class FrameView:
    """What one frame shows of a person, in every view.

    Attributes:
        cameras: C views of the frame, (1, C), in pixels of the images.
        contours: of the person's silhouette, ``[C]``.
        masks: the silhouette, ``[C]`` of (H, W).
        texture: that moved since the frame before; None without any.
        visible: whether each joint's limb was seen in the frame before, (C, J).
    """

    cameras: Camera
    contours: Sequence[Contour]
    masks: Sequence[Mask]
    texture: Texture | None
    visible: Flags


def pixel_lines(camera: Camera, pixels: Tensor) -> Tensor:
    """Direction and moment (N, 6) of the rays of pixels (N, 2) of one view."""
    plane = camera.to_plane(pixels[None, None]).reshape(-1, 2)
    rotation = camera.rotation.reshape(3, 3)
    towards = torch.nn.functional.pad(plane, (0, 1), value=1.0) @ rotation
    centre = camera.centre.reshape(3).expand_as(towards)
    return torch.cat(line_through(centre, towards), -1)
