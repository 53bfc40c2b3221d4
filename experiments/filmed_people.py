"""Videos of people of random shape, in random clothes, who move as recorded, with their truth.

One camera each, of random height, heading and lens, that stands where it sees the whole motion.
Backgrounds are procedural. Nothing but the video is what a capture may see.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from perfcap.actor.anatomy import JOINTS, PARENTS
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.io.body_model import load_body_model
from perfcap.io.video_writer import VideoWriter
from perfcap.render import ProjectedMesh, Texture, look_at, render
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.figure import Figure, actor_figure, pose_figure, rest_turns
from perfcap.train.motion_library import RATE, MotionLibrary, Recording
from perfcap.train.wardrobe import Wardrobe, random_outfit

_TEXTURE = 256  # pixels
_STEPS = (2, 2, 3)  # recorded frames between those of a video of 30 Hz: as it was, or faster
_SEEN = 0.8  # of the image, that the motion fills
_LEVEL, _STEEP = (-5, 25), (-15, 45)  # degrees by which cameras look down
LENSES = 0.8, 1.8  # focal lengths, in sizes of the picture: 64 to 31 degrees
_FARTHEST = 2.4  # rad, that a joint turns


@dataclass(frozen=True)
class Film:
    """A video on disk, the truth about its joints, (F, 16, 3) m in the world, and its camera."""

    name: str
    path: Path
    truth: Tensor
    camera: Camera
    rate: float = 30.0


def films(
    folder: Path,
    library: MotionLibrary,
    count: int,
    frames: int,
    size: int,
    seed: int = 0,
    hard: bool = False,
    lenses: tuple[float, float] = LENSES,
) -> Iterator[Film]:
    """Make so many videos; those of a seed are always the same.

    Focal lengths are between ``lenses``, in sizes of the picture.

    Hard ones show what no lifter has learned: limbs turned up to 1.9 times as far as recorded,
    seen from below and from high above.
    """
    body = load_body_model()
    wardrobe = Wardrobe.of(actor_figure(body.actor(torch.zeros(0, dtype=torch.float64)), _TEXTURE))
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        actor = body.actor(torch.from_numpy(rng.normal(size=10).clip(-2, 2)))
        figure = wardrobe.dress(actor_figure(actor, _TEXTURE), random_outfit(rng), rng)
        step = int(rng.choice(_STEPS))
        fitting = [r for r in library.recordings if len(r.turns) > step * frames]
        recording = fitting[int(rng.integers(len(fitting)))]
        recording = exaggerated(recording, rng) if hard else recording
        start = int(rng.integers(len(recording.turns) - step * frames))
        part = slice(start, start + step * frames, step)
        path = folder / f"film{number}.mp4"
        seen = _film(path, figure, recording, part, size, rng, _STEEP if hard else _LEVEL, lenses)
        yield Film(f"{number}: {recording.name}", path, *seen)


def _film(
    path: Path,
    figure: Figure,
    recording: Recording,
    part: slice,
    size: int,
    rng: np.random.Generator,
    tilt: tuple[float, float],
    lenses: tuple[float, float],
) -> tuple[Tensor, Camera]:
    surfaces, joints = moved(figure, recording, part)
    camera = standing_camera(joints, size, rng, tilt, lenses)
    texture = Texture.from_image(torch.from_numpy(figure.texture), figure.uv, figure.faces_uv)
    behind = torch.from_numpy(Backgrounds().draw(size, rng))
    grain = rng.uniform(0, 6)
    with VideoWriter(path, RATE / 2) as writer:
        for surface in surfaces:
            mesh = ProjectedMesh.seen_by(camera, surface, figure.faces)
            image = render(mesh, texture, behind).image.reshape(size, size, 3).numpy()
            noisy = image + rng.normal(0, grain, (size, size, 1))
            writer.write(np.ascontiguousarray(noisy.clip(0, 255).astype(np.uint8)))
    return joints.double(), camera


def exaggerated(recording: Recording, rng: np.random.Generator) -> Recording:
    """The same with the turns of joints against their parents grown by random factors."""
    turns: list[Tensor] = []
    for joint, parent in enumerate(PARENTS.values()):
        own = recording.turns[:, joint].double()
        if parent is None:
            turns.append(own)
            continue
        name, above = JOINTS[joint], JOINTS.index(parent)
        growth = rng.uniform(0, 0.9) * (1.0 if name[2:] in ("hip", "shoulder") else 0.4)
        turn = matrix_to_rotvec(recording.turns[:, above].double().mT @ own)
        angle = turn.norm(dim=-1, keepdim=True).clamp(min=1e-9)
        grown = turn / angle * ((1 + growth) * angle).clamp(max=_FARTHEST)
        turns.append(turns[above] @ rotvec_to_matrix(grown))
    return replace(recording, turns=torch.stack(turns, 1).to(recording.turns))


def moved(figure: Figure, recording: Recording, part: slice) -> tuple[list[Tensor], Tensor]:
    """Surfaces (V, 3) and landmarks (F, 16, 3), walking as far as their legs are long."""
    rest, path = rest_turns(figure), mid_hip(recording.landmarks[part])
    poses = [pose_figure(figure, figure.vertices, turns, rest) for turns in recording.turns[part]]
    marks = torch.stack([joints for _, joints in poses])
    height = figure.landmarks[0, 1] - figure.landmarks[:, 1].amin()
    theirs = recording.landmarks[..., 1].amax() - recording.landmarks[..., 1].amin()
    there = path * (height / theirs).clamp(0.8, 1.25) - mid_hip(marks)
    moved = [surface + shift for (surface, _), shift in zip(poses, there, strict=True)]
    return moved, marks + there[:, None]


def standing_camera(
    joints: Tensor,
    size: int,
    rng: np.random.Generator,
    tilts: tuple[float, float],
    lenses: tuple[float, float],
) -> Camera:
    """A camera at rest that sees all of a motion, at a random height, with a random lens.

    Args:
        joints: of the motion, (F, 16, 3).
        size: of its square pictures, pixels.
        rng: of everything random.
        tilts: degrees by which it may look down.
        lenses: focal lengths it may have, in sizes of the picture.
    """
    points = joints.flatten(0, 1)
    centre = 0.5 * (points.amin(0) + points.amax(0))
    focal = float(rng.uniform(*lenses)) * size
    reach = float((points - centre).norm(dim=-1).max()) + 0.15
    distance = max(1.5, 2 * reach * focal / (_SEEN * size))
    heading, tilt = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(*tilts))
    ray = [math.cos(tilt) * math.sin(heading), math.sin(tilt), math.cos(tilt) * math.cos(heading)]
    eye = centre + distance * centre.new_tensor(ray)
    rotation, translation = look_at(eye[None], centre[None], centre.new_tensor([[0.0, 1.0, 0.0]]))
    middle = 0.5 * (size - 1)
    lens = centre.new_tensor([[[focal, 0, middle], [0, focal, middle], [0, 0, 1]]])
    return Camera(lens, rotation, translation, size=((size, size),))
