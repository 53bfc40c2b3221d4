"""A place for a person to stand: level ground under a plain sky."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import torch
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.render.lighting import Color
from perfcap.render.texture import to_srgb

COARSER = 2  # pixels along a computed sample: everything here is smooth


@dataclass(frozen=True)
class Backdrop:
    """Ground with a faint checkerboard that fades into the sky.

    Attributes:
        up: unit vector (3,).
        middle: a point of the ground, (3,) m, where it is brightest.
        reach: distance from the middle at which the ground has faded, m.
        tile: side of the checkerboard's squares, m.
        contrast: of the checkerboard, as a share of the ground's light.
        floor: linear RGB of the ground.
        horizon: of the sky at eye level.
        zenith: of the sky overhead.
    """

    up: Tensor
    middle: Tensor
    reach: float = 7.0
    tile: float = 0.5
    contrast: float = 0.10
    floor: Color = (0.36, 0.37, 0.39)
    horizon: Color = (0.58, 0.63, 0.68)
    zenith: Color = (0.22, 0.32, 0.47)

    def seen_by(self, camera: Camera) -> tuple[Tensor, Tensor]:
        """The empty place in one camera.

        Args:
            camera: of one view at one time, batch (1,), with its size.

        Returns:
            Picture (H, W, 3) uint8 sRGB, and where it shows ground, (H, W) bool.
        """
        ray = _rays(camera)  # h w 3, float32
        up, eye = self.up.to(ray), camera.centre[0].to(self.middle)
        climb = ray @ up
        height = float((eye - self.middle) @ self.up.to(eye))
        below = (climb < 0) & (height > 0)
        far = height / (-climb).clamp_min(1e-4)
        east = _level(up)
        north = torch.linalg.cross(up, east)
        offset = (eye - self.middle).to(ray)
        x, y = (offset @ axis + far * (ray @ axis) for axis in (east, north))
        # size on the ground of a sample: across the line of sight, and lengthened along it
        across = COARSER * far / camera.intrinsics[0, 0, 0].to(ray)
        along = across / (-climb).clamp_min(1e-2)
        board = self._board(x, along) * self._board(y, along)
        shown = torch.exp(-(x.square() + y.square()) / self.reach**2) * below
        toward = climb.clamp(0, 1)[..., None]
        sky = torch.lerp(ray.new_tensor(self.horizon), ray.new_tensor(self.zenith), toward)
        floor = ray.new_tensor(self.floor) * (1 + self.contrast * board[..., None])
        picture = to_srgb(torch.lerp(sky, floor, shown[..., None]))
        size = camera.size[0]
        return _enlarged(picture, size, smooth=True), _enlarged(below, size, smooth=False)

    def _board(self, place: Tensor, pixel: Tensor) -> Tensor:
        """Square wave in [-1, 1] along one direction, averaged over a pixel's size."""
        phase = torch.remainder(place / self.tile, 2) - 1  # the wave steps at -1, 0 and 1
        width = (pixel / self.tile).clamp_min(1e-6)
        edge = torch.minimum(phase.abs(), 1 - phase.abs())
        sharp = torch.sign(phase) * (edge / (0.5 * width)).clamp(max=1)
        return sharp / (1 + width.square())


def _rays(camera: Camera) -> Tensor:
    """Unit directions (h, w, 3), float32, that a camera's coarse pixels look along in the world."""
    height, width = (-(-side // COARSER) for side in camera.size[0])
    column, row = torch.meshgrid(torch.arange(width), torch.arange(height), indexing="xy")
    coarse = torch.stack([column, row], -1).reshape(1, -1, 2).to(camera.intrinsics)
    plane = camera.to_plane((coarse + 0.5) * COARSER - 0.5)[0].float()
    ray = torch.nn.functional.pad(plane, (0, 1), value=1.0) @ camera.rotation[0].float()
    return torch.nn.functional.normalize(ray, dim=-1).reshape(height, width, 3)


def _enlarged(picture: Tensor, size: tuple[int, int], smooth: bool) -> Tensor:
    """A coarse picture (h, w, ...) at full size."""
    values = picture.to(torch.uint8).cpu().numpy()
    how = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
    full = cv2.resize(values, None, fx=COARSER, fy=COARSER, interpolation=how)
    return torch.from_numpy(full[: size[0], : size[1]].copy()).to(picture)


def _level(up: Tensor) -> Tensor:
    """A unit vector across another."""
    least = torch.nn.functional.one_hot(up.abs().argmin(), 3).to(up)
    return torch.nn.functional.normalize(torch.linalg.cross(least, up), dim=0)
