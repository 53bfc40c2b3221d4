"""Takes filmed for the tuning of contours: recorded motion, other people and places, with truth.

Nothing of them is a development sequence: people of other recordings, in textured or plain places,
in as many views as wanted, with simulated detections. Settings are chosen here and reported there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from detection_noise import Noise, detect
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.io.actor import load_actor
from perfcap.render import Lighting, ProjectedMesh, Texture, look_at, render, visibility
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.figure import Figure, actor_figure, pose_figure, rest_turns
from perfcap.train.motion_library import MotionLibrary, Recording

_STEP = 2  # of recorded frames: 30 Hz
_HEIGHTS = (1.1, 2.0, 1.4, 2.5, 0.9, 1.7, 2.2, 1.2)  # m, of the cameras
_DISTANCE = 4.4  # m


@dataclass(frozen=True)
class Place:
    """Where a take is filmed.

    Attributes:
        kind: behind the person: ``clutter``, ``plain``, ``noise``, or ``camouflage``, the person's
            own texture.
        size: of the square images, px.
        views: cameras on a circle.
        grain: deviation of the sensor's noise, of 255.
    """

    kind: str = "clutter"
    size: int = 480
    views: int = 6
    grain: float = 2.0


@dataclass(frozen=True)
class Take:
    """Images, detections and truth; ``images[view]`` is (F, H, W, 3) RGB.

    It reads like a clip: ``len`` and ``read_view``.
    """

    name: str
    actor: Actor
    cameras: Camera
    detections: Detections
    images: list[NDArray[np.uint8]]
    masks: list[NDArray[np.bool_]]
    truth: Tensor
    rate: float = 30.0

    def __len__(self) -> int:
        return len(self.truth)

    def read_view(self, view: int, start: int, stop: int) -> NDArray[np.uint8]:
        """RGB frames of a view."""
        return self.images[view][start:stop]


def film(
    name: str,
    actor: Path | str,
    library: MotionLibrary,
    clip: str,
    start: int,
    frames: int,
    seed: int,
    place: Place | None = None,
    noise: Noise | None = None,
) -> Take:
    """A person in a recorded motion, in several views.

    Args:
        name: of the take.
        actor: whose template is filmed and given.
        library: of motion.
        clip: which recording.
        start: frame at 60 Hz.
        frames: at 30 Hz.
        seed: of everything random.
        place: where.
        noise: of detections.
    """
    person = load_actor(str(actor)).double()
    recording = next(r for r in library.recordings if r.name == clip)
    part = slice(start, start + _STEP * frames, _STEP)
    figure = actor_figure(person, 1024)
    return film_figure(name, person, figure, recording, part, seed, place, noise)


def film_figure(
    name: str,
    person: Actor,
    figure: Figure,
    recording: Recording,
    part: slice,
    seed: int,
    place: Place | None = None,
    noise: Noise | None = None,
) -> Take:
    """A figure, dressed or not, in frames of a recorded motion at 60 Hz; see ``film``."""
    place = place or Place()
    rng = np.random.default_rng(seed)
    surfaces, truth = _move(figure, recording, part)
    cameras = _circle(place, truth, float(rng.uniform(0, 2 * math.pi)))
    images, masks = _shoot(figure, surfaces, cameras, place, rng)
    return Take(name, person, cameras, _detect(cameras, truth, rng, noise), images, masks, truth)


def _move(figure: Figure, recording: Recording, span: slice) -> tuple[list[Tensor], Tensor]:
    """Surfaces and landmarks (F, 16, 3) on a floor at y = 0."""
    rest = rest_turns(figure)
    turns, marks = recording.turns[span], recording.landmarks[span]
    posed = [pose_figure(figure, figure.vertices, turn, rest) for turn in turns]
    legs = float((figure.landmarks[8] - figure.landmarks[10]).norm())
    theirs = float((marks[:, 8] - marks[:, 10]).norm(dim=-1).median())
    path = mid_hip(marks) * (legs / theirs)
    path = path - path.mean(0) * torch.tensor([1.0, 0.0, 1.0])
    shift = path - torch.stack([mid_hip(own) for _, own in posed])
    lowest = min(float((v + s)[:, 1].min()) for (v, _), s in zip(posed, shift, strict=True))
    shift = shift - torch.tensor([0.0, lowest, 0.0])
    surfaces = [v + s for (v, _), s in zip(posed, shift, strict=True)]
    return surfaces, torch.stack([m + s for (_, m), s in zip(posed, shift, strict=True)]).double()


def _circle(place: Place, truth: Tensor, heading: float) -> Camera:
    count, size = place.views, place.size
    angle = heading + 2 * math.pi * torch.arange(count, dtype=torch.float64) / count
    high = torch.tensor([_HEIGHTS[view % len(_HEIGHTS)] for view in range(count)]).double()
    middle = truth.reshape(-1, 3).double().mean(0)
    eye = torch.stack((angle.sin() * _DISTANCE, high, angle.cos() * _DISTANCE), -1)
    aim = (middle * torch.tensor([0.0, 1.0, 0.0])).expand(count, 3)
    up = torch.tensor([0.0, 1.0, 0.0]).double().expand(count, 3)
    rotation, translation = look_at(eye, aim, up)
    local = truth.reshape(1, -1, 3) @ rotation.mT + translation[:, None]
    extent = (local[..., :2] / local[..., 2:]).abs().amax((1, 2))
    focal = 0.44 * size / extent
    lens = torch.zeros(count, 3, 3).double()
    lens[:, 0, 0], lens[:, 1, 1], lens[:, 2, 2] = focal, focal, 1.0
    lens[:, :2, 2] = 0.5 * (size - 1)
    return Camera(lens, rotation, translation, size=((size, size),) * count)


def _shoot(
    figure: Figure,
    surfaces: list[Tensor],
    cameras: Camera,
    place: Place,
    rng: np.random.Generator,
) -> tuple[list[NDArray[np.uint8]], list[NDArray[np.bool_]]]:
    texture = Texture.from_image(torch.from_numpy(figure.texture), figure.uv, figure.faces_uv)
    sun = (float(rng.normal()), float(rng.uniform(0.6, 1.5)), float(rng.normal()))
    lighting = Lighting(towards_sun=sun)
    reached = [visibility(s, figure.faces, lighting, 1, 12) for s in surfaces]
    images, masks = [], []
    for view in range(cameras.views):
        behind = torch.from_numpy(_backdrop(place, figure, rng))
        shots, covers = [], []
        for surface, light in zip(surfaces, reached, strict=True):
            mesh = ProjectedMesh.seen_by(cameras.select([view]), surface, figure.faces)
            drawn = render(mesh, texture, behind, lighting, light)
            grain = rng.normal(0, place.grain, drawn.image.shape)
            shots.append((drawn.image.numpy() + grain).clip(0, 255).astype(np.uint8))
            covers.append(drawn.coverage.numpy() > 0.5)
        images.append(np.stack(shots))
        masks.append(np.stack(covers))
    return images, masks


def _backdrop(place: Place, figure: Figure, rng: np.random.Generator) -> NDArray[np.uint8]:
    size = place.size
    if place.kind == "camouflage":
        coat = figure.texture[: len(figure.texture) // 2]
        tiles = np.tile(coat, (size // coat.shape[0] + 1, size // coat.shape[1] + 1, 1))
        return np.ascontiguousarray(tiles[:size, :size])
    if place.kind == "noise":
        return rng.integers(0, 256, (size, size, 3)).astype(np.uint8)
    if place.kind == "plain":
        return np.full((size, size, 3), rng.integers(60, 200, 3), np.uint8)
    return np.asarray(Backgrounds().draw(size, rng), np.uint8)


def _detect(
    cameras: Camera, truth: Tensor, rng: np.random.Generator, noise: Noise | None
) -> Detections:
    local = cameras.to_camera(truth)
    joints, confidence = [], []
    for view in range(cameras.views):
        camera = cameras.select([view])

        def project(points: NDArray[np.float64], camera: Camera = camera) -> NDArray[np.float64]:
            pixels: NDArray[np.float64] = camera.project_camera(torch.tensor(points)[:, None])[
                :, 0
            ].numpy()
            return pixels

        found = detect(local[:, view].numpy(), rng, project, noise)
        joints.append(torch.tensor(found[0]))
        confidence.append(torch.tensor(found[1]))
    return Detections.from_joints(torch.stack(joints, 1), torch.stack(confidence, 1))
