"""Videos of a person whom others pass, in front or behind, with the truth about all of them.

People, clothes, motions, lenses and ways are drawn at random, a video for a number; in a quarter of
them somebody wears what the person wears. Whoever is farther away is drawn first: bodies are whole
in front of or behind one another.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from filmed_people import LENSES, moved, standing_camera
from numpy.typing import NDArray
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.body_model import load_body_model
from perfcap.render import ProjectedMesh, Texture, render
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.figure import Figure, actor_figure
from perfcap.train.motion_library import MotionLibrary, Recording
from perfcap.train.wardrobe import Wardrobe, random_outfit

_TEXTURE = 256  # pixels
_STEP = 2  # recorded frames between those of a video of 30 Hz
_TILTS = (-5, 20)  # degrees by which cameras look down
_APART = (0.6, 2.0)  # m between people who pass and the person, along the line of sight
_ASLANT = 40.0  # degrees from straight across, that ways may be turned by
_FAR = 0.8  # m, that somebody who passes walks at least
_ALIKE = 0.25  # share of videos in which two wear the same
_GROUND = [0, 2]  # axes of the floor


@dataclass(frozen=True)
class Crossed:
    """A video; joints of K people in its pixels, (K, F, 16, 2), the person's first."""

    frames: tuple[NDArray[np.uint8], ...]
    joints2d: Tensor
    alike: bool


def crossed_films(
    library: MotionLibrary, count: int, frames: int, size: int, seed: int
) -> Iterator[Crossed]:
    """Make so many videos; those of a seed are always the same.

    Args:
        library: whose motion.
        count: of the videos.
        frames: of each.
        size: of their square pictures, pixels.
        seed: of everything random.
    """
    body = load_body_model()
    wardrobe = Wardrobe.of(actor_figure(body.actor(torch.zeros(0, dtype=torch.float64)), _TEXTURE))
    walks = [r for r in _long(library, frames) if _way(r, _STEP * frames) > _FAR]
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        alike = rng.random() < _ALIKE
        outfit = random_outfit(rng)
        figures = []
        for place in range(1 + int(rng.integers(1, 3))):
            actor = body.actor(torch.from_numpy(rng.normal(size=10).clip(-2, 2)))
            worn = outfit if place == 0 or (place == 1 and alike) else random_outfit(rng)
            figures.append(wardrobe.dress(actor_figure(actor, _TEXTURE), worn, rng))
        own = _long(library, frames)
        person = moved(figures[0], *_part(own[int(rng.integers(len(own)))], frames, rng))
        camera = standing_camera(person[1], size, rng, _TILTS, LENSES)
        people = [person]
        for figure in figures[1:]:
            recording = walks[int(rng.integers(len(walks)))]
            other = moved(figure, *_part(recording, frames, rng))
            people.append(_passing(other, person[1], camera, rng))
        yield _filmed(figures, people, camera, size, rng, alike)


def _long(library: MotionLibrary, frames: int) -> list[Recording]:
    return [r for r in library.recordings if len(r.turns) > _STEP * frames]


def _way(recording: Recording, length: int) -> float:
    """How far somebody gets in so many recorded frames, m, at least."""
    path = recording.landmarks[:, :, _GROUND].mean(1)
    return float((path[length:] - path[:-length]).norm(dim=-1).min())


def _part(recording: Recording, frames: int, rng: np.random.Generator) -> tuple[Recording, slice]:
    start = int(rng.integers(len(recording.turns) - _STEP * frames))
    return recording, slice(start, start + _STEP * frames, _STEP)


def _passing(
    other: tuple[list[Tensor], Tensor], person: Tensor, camera: Camera, rng: np.random.Generator
) -> tuple[list[Tensor], Tensor]:
    """The same motion on a way that crosses the line of sight to the person, in mid-video."""
    surfaces, joints = other
    when = int(len(joints) * rng.uniform(0.35, 0.65))
    eye = camera.centre[0][_GROUND].to(person)
    there = person[when].mean(0)[_GROUND]
    sight = (there - eye) / (there - eye).norm()
    apart = float(rng.uniform(*_APART)) * (1 if rng.random() < 0.5 else -1)
    apart = max(apart, 1.2 - float((there - eye).norm()))  # not through the camera
    way = (joints[-1] - joints[0]).mean(0)[_GROUND]
    aslant = math.radians(float(rng.uniform(-_ASLANT, _ASLANT)))
    wanted = (
        math.atan2(sight[1], sight[0]) + aslant + (0.5 if rng.random() < 0.5 else 1.5) * math.pi
    )
    turn = math.atan2(way[1], way[0]) - wanted  # about y, from x to z it is negative
    rotation = rotvec_to_matrix(joints.new_tensor([0.0, turn, 0.0]))
    shift = joints.new_zeros(3)
    turned = joints @ rotation.mT
    shift[_GROUND] = there + apart * sight - turned[when].mean(0)[_GROUND]
    return [surface @ rotation.mT.to(surface) + shift.to(surface) for surface in surfaces], (
        turned + shift
    )


def _filmed(
    figures: list[Figure],
    people: list[tuple[list[Tensor], Tensor]],
    camera: Camera,
    size: int,
    rng: np.random.Generator,
    alike: bool,
) -> Crossed:
    textures = [
        Texture.from_image(torch.from_numpy(each.texture), each.uv, each.faces_uv)
        for each in figures
    ]
    behind = torch.from_numpy(Backgrounds().draw(size, rng))
    grain = rng.uniform(0, 6)
    eye = camera.centre[0]
    joints = torch.stack([each for _, each in people]).double()
    images = []
    for frame in range(joints.shape[1]):
        image = behind
        far = (joints[:, frame].mean(1) - eye.double()).norm(dim=-1)
        for place in far.argsort(descending=True).tolist():
            mesh = ProjectedMesh.seen_by(camera, people[place][0][frame], figures[place].faces)
            image = render(mesh, textures[place], image).image.reshape(size, size, 3)
        noisy = image.numpy() + rng.normal(0, grain, (size, size, 1))
        images.append(np.ascontiguousarray(noisy.clip(0, 255).astype(np.uint8)))
    lens = camera.every_frame(1)
    seen = torch.stack([lens.project(each.to(lens.rotation))[:, 0] for each in joints])
    return Crossed(tuple(images), seen.double(), alike)
