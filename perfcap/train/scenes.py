"""Pictures of people with exact joints: rendered on the way, without end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.detect.viewing_ray import toward
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.render import Lighting, ProjectedMesh, Texture, look_at, rasterize, render, visibility
from perfcap.render.lighting import Color
from perfcap.train.backgrounds import Backgrounds, Picture, add_shape, surface
from perfcap.train.body_parts import part_map_size
from perfcap.train.cast import Cast, Posed
from perfcap.train.config import SceneData
from perfcap.train.loop import mixed_seed

_LOWEST = 0.25  # sine of the sun's least elevation, for shadows on the ground
_ROOM = 1.5  # size of a place, in pictures taken of it
_NEAREST = 0.6  # m between camera and person


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture and its truth.

    Attributes:
        image: (S, S, 3) RGB.
        joints2d: landmarks, pixels of the image, (16, 2).
        joints3d: root-relative, camera axes, (16, 3) m.
        focal: of the camera, whose axis goes through the middle of the image, pixels.
        present: whether anybody is there; joints mean nothing otherwise.
        parts: what of the body is seen, whatever is before it, (S/4, S/4), indices in ``PARTS``.
    """

    image: Picture
    joints2d: NDArray[np.float32]
    joints3d: NDArray[np.float32]
    focal: float
    present: bool
    parts: Picture


class Scenes:
    """Pictures by number: the same number gives the same group of pictures, on any machine.

    Args:
        cast: whom to draw.
        backgrounds: what is behind them.
        data: settings.
        seed: of everything random.
    """

    def __init__(self, cast: Cast, backgrounds: Backgrounds, data: SceneData, seed: int) -> None:
        self._cast, self._backgrounds, self._data, self._seed = cast, backgrounds, data, seed

    @property
    def group_size(self) -> int:
        """Pictures in a group."""
        return self._data.group

    def group(self, number: int) -> list[Shot]:
        """``data.group`` pictures of one person in one outfit, in other poses and places."""
        rng = np.random.default_rng(mixed_seed(self._seed, number))
        person = self._cast.person(rng)
        texture = Texture.from_image(
            torch.from_numpy(person.figure.texture), *self._cast.texture_places(person)
        )
        size = round(_ROOM * self._data.size)
        places = [self._backgrounds.draw(size, rng) for _ in range(self._data.places)]
        shots = []
        for _ in range(self._data.group):
            background = _part(places[int(rng.integers(len(places)))], self._data.size, rng)
            posed = self._cast.pose(person, rng)
            shots.append(self._shot(posed, texture, background, rng))
        return shots

    def _shot(
        self, posed: Posed, texture: Texture, background: Picture, rng: np.random.Generator
    ) -> Shot:
        data = self._data
        if rng.random() < data.empty:
            none = np.zeros((len(LANDMARKS), 3), np.float32)
            nobody = np.zeros((part_map_size(data.size),) * 2, np.uint8)
            return Shot(background, none[:, :2], none, 1.0, False, nobody)
        view = _random_view(posed, data, rng)
        mesh, joints2d = view.see(posed)
        lighting, sun = random_lighting(rng)
        reached = None
        if rng.random() < data.shadowed:
            reached = visibility(posed.vertices, posed.faces, lighting, 1, 3)
        if rng.random() < 0.6:
            _shade_floor(background, view, posed, sun, rng)
        fine = 2 if rng.random() < 0.4 else 1
        behind = torch.from_numpy(background)
        image = render(mesh, texture, behind, lighting, reached, fine).image.numpy()
        if rng.random() < data.occluded:
            _occlude(image, joints2d.numpy(), surface(data.size, rng), rng)
        local = posed.landmarks @ view.rotation.T
        relative = local - mid_hip(local)
        parts = view.parts(posed)
        return Shot(image, joints2d.numpy(), relative.numpy(), view.focal, True, parts)


@dataclass(frozen=True, eq=False)
class _View:
    """A camera that looks at the middle of somebody's joints."""

    rotation: Tensor  # world to camera, (3, 3)
    translation: Tensor  # (3,)
    focal: float  # px
    size: int  # px

    def see(self, posed: Posed) -> tuple[ProjectedMesh, Tensor]:
        """The mesh and the landmarks (16, 2) in the image."""
        pixels, depth = self.project(posed.vertices)
        mesh = ProjectedMesh(posed.vertices, posed.faces, pixels, depth, (self.size, self.size))
        return mesh, self.project(posed.landmarks)[0]

    def parts(self, posed: Posed) -> Picture:
        """The part of the body that each pixel of the small map sees."""
        side = part_map_size(self.size)
        pixels, depth = self.project(posed.vertices)
        small = (pixels + 0.5) * side / self.size - 0.5
        seen = rasterize(small, depth, posed.faces, (side, side))
        return np.asarray(seen.label(posed.parts).numpy(), np.uint8)

    def project(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Pixels (N, 2) and depth (N,) of points (N, 3)."""
        local = points @ self.rotation.T + self.translation
        depth = local[:, 2]
        plane = local[:, :2] / depth[:, None].clamp(min=0.05)
        return self.focal * plane + 0.5 * (self.size - 1), depth


def _part(place: Picture, size: int, rng: np.random.Generator) -> Picture:
    """A random square of a place, perhaps mirrored."""
    x, y = (int(v) for v in rng.integers(0, len(place) - size + 1, 2))
    part = place[y : y + size, x : x + size]
    return np.ascontiguousarray(part[:, ::-1] if rng.random() < 0.5 else part)


def _random_view(posed: Posed, data: SceneData, rng: np.random.Generator) -> _View:
    middle = 0.5 * (posed.landmarks.amin(0) + posed.landmarks.amax(0))
    reach = float((posed.landmarks - middle).norm(dim=-1).max())
    low, high = (math.log(v) for v in data.distance)
    distance = max(math.exp(rng.uniform(low, high)), reach + _NEAREST)
    mean, deviation = data.elevation
    pitch = math.radians(min(75.0, max(-35.0, rng.normal(mean, deviation))))
    eye = middle + distance * torch.tensor([0.0, math.sin(pitch), math.cos(pitch)])
    rotation, translation = look_at(eye, middle, torch.tensor([0.0, 1.0, 0.0]))
    roll = torch.tensor([0.0, 0.0, math.radians(rng.normal(0, data.roll))])
    turn = rotvec_to_matrix(roll)
    rotation, translation = turn @ rotation, turn @ translation
    # aimed again, at the middle of what is seen
    local = posed.landmarks @ rotation.T + translation
    plane = local[:, :2] / local[:, 2:]
    aim = toward(0.5 * (plane.amin(0) + plane.amax(0))).T
    rotation, translation = aim @ rotation, aim @ translation
    local = posed.landmarks @ rotation.T + translation
    plane = local[:, :2] / local[:, 2:]
    extent = float((plane.amax(0) - plane.amin(0)).max())
    return _View(rotation, translation, data.size / (data.margin * extent), data.size)


def random_lighting(rng: np.random.Generator) -> tuple[Lighting, NDArray[np.float64]]:
    """Lights, and the direction of the sun, unit (3,)."""
    sun = rng.normal(size=3)
    sun[1] = abs(sun[1]) + _LOWEST
    sun /= np.linalg.norm(sun)
    total = rng.uniform(0.55, 1.35)
    share = rng.dirichlet([1.0, 1.6, 1.8])
    tint = 1 + rng.normal(0, 0.07, (3, 3))
    strength = total * share * np.array([1.0, 1.2, 1.7])
    ambient, sky, lamp = (_color(row) for row in strength[:, None] * tint)
    return Lighting(ambient, sky, lamp, _color(sun)), sun


def _color(values: NDArray[np.float64]) -> Color:
    first, second, third = (float(value) for value in values)
    return first, second, third


def _shade_floor(
    background: Picture,
    view: _View,
    posed: Posed,
    sun: NDArray[np.float64],
    rng: np.random.Generator,
) -> None:
    """Darken where the person takes the sun from the ground, in place."""
    height = posed.vertices[:, 1] - posed.vertices[:, 1].min()
    slope = torch.from_numpy((sun / sun[1]).astype(np.float32))
    pixels, depth = view.project(posed.vertices - height[:, None] * slope)
    small = view.size // 2
    taken = rasterize((pixels + 0.5) / 2 - 0.5, depth, posed.faces, (small, small)).mask
    soft = cv2.GaussianBlur(taken.float().numpy(), (0, 0), float(rng.uniform(0.5, 3)))
    left = 1 - rng.uniform(0.15, 0.75) * cv2.resize(soft, (view.size, view.size))
    background[:] = (background * left[..., None]).astype(np.uint8)


def _occlude(
    image: Picture, joints: NDArray[np.float32], cloth: Picture, rng: np.random.Generator
) -> None:
    """Put things in front of somebody, in place."""
    extent = float((joints.max(0) - joints.min(0)).max())
    for _ in range(int(rng.integers(1, 4))):
        near = joints[int(rng.integers(len(joints)))]
        center = near + rng.normal(0, 0.06 * extent, 2)
        add_shape(image, cloth, center, extent * rng.uniform(0.05, 0.22), rng)
