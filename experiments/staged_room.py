"""Furnished rooms that nobody is in: floors, walls, pictures, things that stand about, light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.render import Lighting, ProjectedMesh, Texture, rasterize, render
from perfcap.train.backgrounds import Backgrounds, natural_color

_TILE = 0.25  # m, of surfaces
_NEAR = 0.1  # m: what is nearer to the camera is not drawn


@dataclass(frozen=True)
class Surface:
    """Something with a picture on it.

    Attributes:
        vertices: (V, 3) m.
        faces: (T, 3).
        texture: of them.
        ground: whether shadows fall on it.
    """

    vertices: Tensor
    faces: Tensor
    texture: Texture
    ground: bool = False


def random_lights(rng: np.random.Generator) -> Lighting:
    """Between a bright window and an even sky."""
    sun = float(rng.uniform(0.1, 0.9))
    ambient, sky = 0.15, 1.15 - sun
    towards = rng.normal(size=3)
    tint = 1 + rng.normal(0, 0.04, (2, 3))
    return Lighting(
        ambient=(ambient,) * 3,
        sky=tuple(float(v) for v in sky * tint[0]),  # type: ignore[arg-type]
        sun=tuple(float(v) for v in sun * tint[1]),  # type: ignore[arg-type]
        towards_sun=(float(towards[0]), 0.6 + abs(float(towards[1])), float(towards[2])),
    )


def furnished(joints: Tensor, cameras: Camera, rng: np.random.Generator) -> list[Surface]:
    """A floor, two walls behind, a picture on one of them, and things that stand about."""
    points = joints.flatten(0, 1)
    centre, reach = points.mean(0), float((points - points.mean(0)).norm(dim=-1).max())
    camera = one_camera(cameras, 0)
    ahead = camera.rotation[0, 2] * torch.tensor([1.0, 0.0, 1.0])
    ahead = ahead / ahead.norm()
    aside = torch.stack((ahead[2], ahead[0] * 0, -ahead[0]))
    up = torch.tensor([0.0, 1.0, 0.0])
    eye = -(camera.rotation[0].T @ camera.translation[0])
    corner = eye * torch.tensor([1.0, 0.0, 1.0]) - 6 * aside
    away = float((centre - eye) @ ahead) + reach + float(rng.uniform(0.5, 2.5))
    tall, wide = 2 * away + 2.5, away + 6
    parts = [
        _panel(corner, (12, aside), (wide, ahead), rng, ground=True),
        _panel(corner + away * ahead, (12, aside), (tall, up), rng),
        _panel(corner + (away - 0.02) * ahead + float(rng.uniform(3, 8)) * aside
               + float(rng.uniform(0.3, 1.2)) * up,
               (float(rng.uniform(0.6, 1.8)), aside), (float(rng.uniform(0.6, 1.6)), up), rng),
    ]  # fmt: skip
    for _ in range(int(rng.integers(2, 6))):
        sideways = float(rng.uniform(-1.0, 1.0)) * (reach + 1.5)
        place = centre * torch.tensor([1.0, 0.0, 1.0]) + sideways * aside
        place = place + (reach + float(rng.uniform(0.2, 0.5))) * ahead
        width, height = float(rng.uniform(0.2, 0.9)), float(rng.uniform(0.3, 1.9))
        parts.append(_panel(place, (width, aside), (height, up), rng))
        parts.append(_panel(place, (height, up), (0.4, ahead), rng))
    return parts


def _panel(
    corner: Tensor,
    first: tuple[float, Tensor],
    second: tuple[float, Tensor],
    rng: np.random.Generator,
    ground: bool = False,
) -> Surface:
    """A rectangle with something on it, in tiles that are cut off behind the camera."""
    counts = [max(2, math.ceil(length / _TILE)) for length, _ in (first, second)]
    a, b = (torch.linspace(0, 1, count + 1) for count in counts)
    grid = torch.stack(torch.meshgrid(a, b, indexing="ij"), -1).reshape(-1, 2)
    vertices = corner + sum(
        grid[:, i : i + 1] * length * way for i, (length, way) in enumerate((first, second))
    )
    row, column = (torch.from_numpy(v.ravel()) for v in np.mgrid[: counts[0], : counts[1]])
    at = row * (counts[1] + 1) + column
    quads = torch.stack((at, at + 1, at + counts[1] + 1, at + counts[1] + 2), -1)
    faces = torch.cat((quads[:, [0, 1, 2]], quads[:, [1, 3, 2]]))
    picture = Backgrounds().draw(512, rng)
    if rng.random() < 0.4:  # plain walls and floors
        plain = np.full_like(picture, natural_color(rng).clip(40, 220).astype(np.uint8))
        picture = cv2.addWeighted(plain, 0.85, picture, 0.15, 0)
    uv = grid if max(first[0], second[0]) < 3 else 0.5 - 0.5 * torch.cos(2 * math.pi * grid)
    return Surface(
        vertices, faces, Texture.from_image(torch.from_numpy(picture), uv, faces), ground
    )


def empty_room(
    room: Sequence[Surface], camera: Camera, lighting: Lighting
) -> tuple[Tensor, Tensor]:
    """The room without anybody (H, W, 3), and where its floor is seen."""
    height, width = camera.size[0]
    image = torch.full((height, width, 3), 120, dtype=torch.uint8)
    depth = torch.full((height, width), torch.inf)
    floor = torch.zeros(height, width, dtype=torch.bool)
    for surface in room:
        mesh = ProjectedMesh.seen_by(camera, surface.vertices, surface.faces)
        whole = (mesh.depth[surface.faces] > _NEAR).all(-1)
        if not bool(whole.any()):
            continue
        texture = replace(surface.texture, faces=surface.texture.faces[whole])
        mesh = replace(mesh, faces=surface.faces[whole])
        drawn = render(mesh, texture, image, lighting, supersampling=2).image
        seen = rasterize(mesh.pixels, mesh.depth, mesh.faces, (height, width))
        nearer = seen.mask & (seen.depth < depth)
        image = torch.where(nearer[..., None], drawn.reshape(height, width, 3), image)
        depth = torch.where(nearer, seen.depth.to(depth), depth)
        floor = torch.where(nearer, surface.ground, floor)
    return image, floor


def one_camera(cameras: Camera, frame: int) -> Camera:
    """The camera of a frame, batch (1,)."""
    if not cameras.moving:
        return cameras.to(torch.zeros(()))
    now = (cameras.intrinsics, cameras.rotation, cameras.translation)
    intrinsics, rotation, translation = (part[frame].float() for part in now)
    return Camera(intrinsics, rotation, translation, size=cameras.size)
