"""Short rendered clips of two views, with truth: people of random shape and clothes, or actors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.geometry.camera import Camera
from perfcap.io.body_model import load_body_model
from perfcap.render import ProjectedMesh, Texture, look_at, render
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.figure import Figure, actor_figure, pose_figure, rest_turns
from perfcap.train.motion_library import MotionLibrary
from perfcap.train.wardrobe import Wardrobe, random_outfit

_STEP = 4  # recorded frames between those of a clip: 15 Hz
_FOCAL, _DISTANCE = 2.0, 4.6  # image sizes; m
_TEXTURE = 192  # pixels


@dataclass(frozen=True)
class Filming:
    """Frames of a clip, and pixels along its square images."""

    frames: int
    size: int


@dataclass(frozen=True)
class Clip:
    """Images (F, C, 3, H, W), joints in them (F, C, 16, 2) and in the world (F, 16, 3)."""

    actor: Actor
    cameras: Camera
    images: Tensor
    pixels: Tensor
    joints: Tensor


def strangers(
    count: int, settings: Filming, library: MotionLibrary, rng: np.random.Generator
) -> list[Clip]:
    """Clips of as many people of random shape, in random clothes."""
    body = load_body_model()
    wardrobe = Wardrobe.of(actor_figure(body.actor(torch.zeros(0, dtype=torch.float64)), _TEXTURE))
    clips = []
    for _ in range(count):
        actor = body.actor(torch.from_numpy(rng.normal(size=10).clip(-2, 2)))
        figure = wardrobe.dress(actor_figure(actor, _TEXTURE), random_outfit(rng), rng)
        clips.append(_clip(settings, actor, figure, library, rng))
    return clips


def performances(
    count: int,
    actors: Sequence[Actor],
    settings: Filming,
    library: MotionLibrary,
    rng: np.random.Generator,
) -> list[Clip]:
    """Clips of actors in turn, with their own textures."""
    chosen = [actors[number % len(actors)] for number in range(count)]
    return [_clip(settings, a, actor_figure(a, _TEXTURE), library, rng) for a in chosen]


def _clip(
    settings: Filming,
    actor: Actor,
    figure: Figure,
    library: MotionLibrary,
    rng: np.random.Generator,
) -> Clip:
    """Somebody's motion about the origin, in two views a quarter of a turn apart."""
    count, size = settings.frames, settings.size
    recording = library.recordings[int(rng.integers(len(library.recordings)))]
    room = max(1, len(recording.turns) - _STEP * count)
    start = int(rng.integers(room))
    turns = recording.turns[start : start + _STEP * count : _STEP]
    cameras = _cameras(size, float(rng.uniform(0, 2 * math.pi)))
    behind = [torch.from_numpy(Backgrounds().draw(size, rng)) for _ in range(cameras.views)]
    texture = Texture.from_image(torch.from_numpy(figure.texture), figure.uv, figure.faces_uv)
    rest = rest_turns(figure)
    images, joints = [], []
    for frame in turns:
        surface, marks = pose_figure(figure, figure.vertices, frame, rest)
        for view in range(cameras.views):
            mesh = ProjectedMesh.seen_by(cameras.select([view]), surface, figure.faces)
            images.append(render(mesh, texture, behind[view]).image)
        joints.append(marks)
    world = torch.stack(joints).double()
    stacked = torch.stack(images).reshape(len(turns), cameras.views, size, size, 3)
    return Clip(actor, cameras, stacked.movedim(-1, 2), cameras.project(world), world)


def _cameras(size: int, heading: float) -> Camera:
    angle = heading + 0.5 * math.pi * torch.arange(2, dtype=torch.float64)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    eye = _DISTANCE * torch.stack((angle.sin(), 0 * angle + 0.15, angle.cos()), -1)
    rotation, translation = look_at(eye, -0.05 * up.expand(2, 3), up.expand(2, 3))
    middle, focal = 0.5 * (size - 1), _FOCAL * size
    lens = up.new_tensor([[focal, 0, middle], [0, focal, middle], [0, 0, 1]]).expand(2, 3, 3)
    return Camera(lens, rotation, translation, size=((size, size),) * 2)
