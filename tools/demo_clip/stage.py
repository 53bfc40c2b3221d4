"""The set of the demo: a dance studio in one formula per surface, seen by one fixed camera."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.render import Lighting, look_at
from perfcap.render.texture import to_srgb

Floats = NDArray[np.float64]

SIZE = 720  # px, height and width
FOCAL = 1300.0  # px
EYE, TARGET = (0.35, 1.5, 4.9), (0.0, 1.0, 0.0)  # m
LIGHTING = Lighting(
    ambient=(0.11, 0.115, 0.13),
    sky=(0.42, 0.45, 0.50),
    sun=(0.86, 0.78, 0.66),
    towards_sun=(0.5, 0.95, 0.7),
)
WALL = -2.7  # m, its z; the floor has height 0
PLANK = (0.155, 1.9)  # m, width and length; planks run away from the camera
RAIL = 1.02, 0.024  # m, height and radius of the barre
SAMPLES = 4  # along each side of a pixel
_OAK, _PAINT = np.array([0.50, 0.40, 0.30]), np.array([0.185, 0.315, 0.35])  # linear RGB
_WHITE, _RAIL_WOOD = np.array([0.62, 0.61, 0.58]), np.array([0.36, 0.20, 0.10])


def camera() -> Camera:
    """A fixed camera that sees the whole dance, batch (1,)."""
    points = torch.tensor([EYE, TARGET, (0.0, 1.0, 0.0)], dtype=torch.float64)
    rotation, translation = look_at(*points)
    middle = (SIZE - 1) / 2
    intrinsics = points.new_tensor([[FOCAL, 0, middle], [0, FOCAL, middle], [0, 0, 1]])
    return Camera(intrinsics[None], rotation[None], translation[None], None, ((SIZE, SIZE),))


def plate(view: Camera, seed: int) -> tuple[Tensor, Tensor]:
    """The empty stage.

    Returns:
        Picture (H, W, 3) uint8 sRGB, and where it shows the floor (H, W) bool.
    """
    height, width = view.size[0]
    light, floor = np.zeros((height, width, 3)), np.zeros((height, width))
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    for down in offsets:
        for across in offsets:
            here, below = _look(view, across, down, np.random.default_rng(seed))
            light += here / SAMPLES**2
            floor += below / SAMPLES**2
    return to_srgb(torch.tensor(light, dtype=torch.float32)), torch.tensor(floor > 0.5)


def _look(
    view: Camera, across: float, down: float, rng: np.random.Generator
) -> tuple[Floats, NDArray[np.bool_]]:
    """Light and floor mask along one ray of every pixel."""
    height, width = view.size[0]
    row, column = np.mgrid[:height, :width].astype(float)
    pixels = torch.tensor(np.stack([column + across, row + down], -1)).reshape(1, -1, 2)
    plane = torch.nn.functional.pad(view.to_plane(pixels), (0, 1), value=1.0)[0]
    ray = (plane @ view.rotation[0]).numpy().reshape(height, width, 3)
    eye = view.centre[0].numpy()
    to_floor = np.where(ray[..., 1] < 0, -eye[1] / np.minimum(ray[..., 1], -1e-9), np.inf)
    to_wall = (WALL - eye[2]) / np.minimum(ray[..., 2], -1e-9)
    below = to_floor < to_wall
    point = eye + np.minimum(to_floor, to_wall)[..., None] * ray
    noise = Noise(rng)
    floor = _floor(point[..., 0], point[..., 2], noise) * _irradiance((0.0, 1.0, 0.0))
    wall = _wall(point[..., 0], point[..., 1], noise) * _irradiance((0.0, 0.0, 1.0))
    return np.where(below[..., None], floor, wall), below


def _irradiance(normal: tuple[float, float, float]) -> Floats:
    light: Floats = LIGHTING.on(torch.tensor([normal])).double().numpy()[0]
    return light


def _floor(x: Floats, z: Floats, noise: Noise) -> Floats:
    """Oiled planks, each with a tone and a grain of its own."""
    column = np.floor(x / PLANK[0])
    shifted = z / PLANK[1] + noise.cell(column, 0 * column)
    row = np.floor(shifted)
    tone = 0.86 + 0.28 * noise.cell(column, row)
    far = 40 * noise.cell(row, column)
    grain = noise.smooth(42 * x + far, 1.3 * z) + 0.6 * noise.smooth(120 * x + far, 3.5 * z)
    rings = np.sin(34 * (x + 0.035 * noise.smooth(3 * x + far, 0.9 * z)) + far)
    within, along = np.mod(x / PLANK[0], 1), np.mod(shifted, 1)
    gap = np.minimum(within, 1 - within) * PLANK[0]
    butt = np.minimum(along, 1 - along) * PLANK[1]
    seam = 1 - 0.55 * np.exp(-((gap / 0.0022) ** 2)) - 0.45 * np.exp(-((butt / 0.002) ** 2))
    corner = 1 - 0.4 * np.exp(-(z - WALL) / 0.22)
    brightness = tone * (1 + 0.10 * (grain - 0.8) + 0.035 * rings) * seam * corner
    warmth = 1 + 0.05 * (noise.cell(column, row + 7) - 0.5)[..., None] * np.array([1, 0, -1])
    color: Floats = _OAK * warmth * brightness[..., None]
    return color


def _wall(x: Floats, y: Floats, noise: Noise) -> Floats:
    """Plaster behind a barre, over a skirting board, with the light of a tall window on it."""
    plaster = (
        1 + 0.05 * (noise.smooth(1.7 * x, 1.7 * y) - 0.5) + 0.05 * noise.smooth(60 * x, 60 * y)
    )
    falloff = 0.94 - 0.05 * (y - 1.2) - 0.05 * np.abs(x)
    color = _PAINT * (plaster * falloff * (0.86 + 0.55 * _window(x, y)))[..., None]
    shade = _band(y, RAIL[0] - 0.13, 0.03, 0.02) + 0.7 * _brackets(x - 0.05, y + 0.06)
    color = color * (1 - 0.35 * np.clip(shade, 0, 1))[..., None]
    skirting = y < 0.14
    board = _WHITE * (0.82 - 0.25 * np.exp(-((y - 0.128) ** 2) / 2e-5))[..., None]
    color = np.where(skirting[..., None], board, color)
    color = color * (1 - 0.35 * np.exp(-y / 0.05))[..., None]
    color = np.where((_brackets(x, y) > 0.5)[..., None], 0.12 * np.ones(3), color)
    rounded = np.clip(1 - ((y - RAIL[0]) / RAIL[1]) ** 2, 0, 1) ** 0.5
    lit = 0.5 + 0.8 * rounded * (0.6 + 0.4 * np.clip((y - RAIL[0]) / RAIL[1], -1, 1))
    on_rail = np.abs(y - RAIL[0]) < RAIL[1]
    return np.where(on_rail[..., None], _RAIL_WOOD * lit[..., None], color)


def _window(x: Floats, y: Floats) -> Floats:
    """Soft light of six panes, leaning as the sun falls, (…) in [0, 1]."""
    across = x + 0.35 * (y - 1.5) + 0.55
    total = np.zeros_like(x)
    for column in (-0.42, 0.0, 0.42):
        for row in (1.15, 1.85, 2.55):
            total = total + _band(across, column, 0.19, 0.035) * _band(y, row, 0.31, 0.04)
    return total


def _brackets(x: Floats, y: Floats) -> Floats:
    apart = np.mod(x + 0.55, 1.5) - 0.75
    return _band(apart, 0.0, 0.014, 0.004) * _band(y, RAIL[0] - 0.045, 0.045, 0.004)


def _band(value: Floats, middle: float, half: float, soft: float) -> Floats:
    """1 within ``half`` of the middle, 0 beyond, with an edge of width ``soft``."""
    edge: Floats = 0.5 - 0.5 * np.tanh((np.abs(value - middle) - half) / soft)
    return edge


class Noise:
    """Lattice noise in [0, 1] from a table of random numbers."""

    def __init__(self, rng: np.random.Generator, side: int = 256) -> None:
        self.side = side
        self.table = rng.random((side, side))

    def cell(self, x: Floats, y: Floats) -> Floats:
        """One number for every pair of whole numbers."""
        column, row = np.floor(x).astype(int), np.floor(y).astype(int)
        value: Floats = self.table[column % self.side, row % self.side]
        return value

    def smooth(self, x: Floats, y: Floats) -> Floats:
        """Cubic blend of the numbers at the four whole corners around a point."""
        u, v = x - np.floor(x), y - np.floor(y)
        u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
        near = (1 - u) * self.cell(x, y) + u * self.cell(x + 1, y)
        far = (1 - u) * self.cell(x, y + 1) + u * self.cell(x + 1, y + 1)
        blended: Floats = (1 - v) * near + v * far
        return blended
