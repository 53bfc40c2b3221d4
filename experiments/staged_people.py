"""Clothed people who move about a furnished room, filmed by one camera, with all of their truth.

Nothing here is what captures were developed on: bodies, clothes, motions, rooms, lights, lenses and
the shake of the hand that holds a camera are drawn at random, a clip for a number. Every third
person wears a skirt that hangs as it will, which its template only skins to the legs. Cast shadows
are drawn, and the whole is a compressed video.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from filmed_people import moved
from numpy.typing import NDArray
from staged_cameras import HELD, Handling, shake, staged_camera
from staged_room import empty_room, furnished, one_camera, random_lights
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.template import Template
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.geometry.camera import Camera
from perfcap.io.body_model import load_body_model
from perfcap.io.clip import Clip
from perfcap.io.video_writer import VideoWriter
from perfcap.render import (
    ProjectedMesh,
    Texture,
    render,
    shade_ground,
    visibility,
)
from perfcap.train.config import DetectorNoise
from perfcap.train.detector_noise import corrupt
from perfcap.train.figure import (
    Figure,
    Skirt,
    actor_figure,
    hang,
    random_skirt,
    rest_turns,
    skirt_mesh,
)
from perfcap.train.motion_library import MotionLibrary, Recording
from perfcap.train.wardrobe import Wardrobe, random_outfit

Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]

RATE = 30.0
_STEP = 2  # recorded frames between those of a video
_TEXTURE, _CLOTH = 512, 96  # px: texture of the body, rows below it for a skirt
_HELD, _SIDES = 0.6, 0.3  # m below the hips and to their sides, over which a skirt goes to a thigh
_CALM = 0.15  # m, by which knees stay below the hips of who wears a skirt
_DEPTH_NOISE, _NOISE = 0.040, 0.020  # m, of 3D detections
_KEPT = 0.8  # of that noise, from frame to frame


@dataclass(frozen=True)
class Staged:
    """A clip on disk, what a capture may know of it, and what it may not.

    Attributes:
        name: number, motion, and what is special.
        actor: the clothed person.
        cameras: one view, (1,) or (F, 1) where it moves.
        detections: (F, 1, 16), as detectors err.
        clip: the video.
        truth: landmarks, (F, 16, 3) m; for scoring only.
        masks: (F, H, W); for scoring only.
    """

    name: str
    actor: Actor
    cameras: Camera
    detections: Detections
    clip: Clip
    truth: Tensor
    masks: Mask


@dataclass(frozen=True)
class Dressed:
    """A person and what is drawn of them."""

    figure: Figure
    skirt: Skirt | None
    actor: Actor

    def drawn(self, surface: Tensor, hips: Tensor, turn: Tensor) -> Tensor:
        """Vertices (V, 3) of body and skirt in a pose."""
        if self.skirt is None:
            return surface
        return torch.cat((surface, hang(self.skirt, self.figure, surface, hips, turn)))

    @property
    def faces(self) -> Tensor:
        """Of body and skirt, (T, 3)."""
        body = self.figure.faces
        return (
            body
            if self.skirt is None
            else torch.cat((body, skirt_mesh()[0] + len(self.figure.vertices)))
        )

    @property
    def texture(self) -> Texture:
        """Of both."""
        uv, faces = _texture_places(self.figure, self.skirt is not None)
        return Texture.from_image(torch.from_numpy(self.figure.texture), uv, faces)


def staged(
    folder: Path,
    library: MotionLibrary,
    number: int,
    frames: int,
    size: int,
    seed: int = 0,
    handling: Handling | None = None,
) -> Staged:
    """The clip of a number; every third person wears a skirt, every third camera is held by hand.

    Args:
        folder: where its video goes.
        library: recorded motion.
        number: of the clip.
        frames: F.
        size: of the square images, px.
        seed: of a series of clips.
        handling: of the camera, whatever the number is.
    """
    rng = np.random.default_rng([seed, number])
    if handling is None and number % 3 == 2:
        handling = HELD
    person = _person(rng, skirted=number % 3 == 1)
    fitting = [r for r in library.recordings if len(r.turns) > _STEP * frames]
    if person.skirt is not None:
        fitting = [each for each in fitting if _is_calm(each)]
    recording = fitting[int(rng.integers(len(fitting)))]
    start = int(rng.integers(len(recording.turns) - _STEP * frames))
    part = slice(start, start + _STEP * frames, _STEP)
    surfaces, joints = moved(person.figure, recording, part)
    lowest = torch.stack([surface[:, 1].amin() for surface in surfaces]).amin()
    up = torch.stack((lowest * 0, -lowest, lowest * 0))  # the floor is at 0
    joints = joints + up
    turns = recording.turns[part, 0] @ rest_turns(person.figure)[0]
    drawn = [
        person.drawn(surface + up, hips, turn)
        for surface, hips, turn in zip(surfaces, mid_hip(joints), turns, strict=True)
    ]
    cameras = staged_camera(joints, size, rng, handling, RATE)
    path = folder / f"staged{number}.mp4"
    masks = _film(path, person, drawn, joints, cameras, rng)
    dress = ", in a skirt" if person.skirt is not None else ""
    what = dress if handling is None else f", {handling.name}"
    return Staged(
        name=f"{number}: {recording.name}{what}",
        actor=person.actor,
        cameras=cameras,
        detections=_detections(joints.double(), cameras, rng),
        clip=Clip.open([str(path)]),
        truth=joints.double(),
        masks=masks,
    )


def _is_calm(recording: Recording) -> bool:
    """Whether knees stay so low that a skirt can hang: nothing here lets one ride up."""
    at = [recording.landmarks[:, LANDMARKS.index(name), 1] for name in ("l_knee", "r_knee")]
    hips = mid_hip(recording.landmarks)[:, 1]
    return bool((torch.stack(at).amax(0) < hips - _CALM).all())


def _person(rng: np.random.Generator, skirted: bool) -> Dressed:
    body = load_body_model()
    wardrobe = Wardrobe.of(actor_figure(body.actor(torch.zeros(0, dtype=torch.float64)), _TEXTURE))
    shape = torch.from_numpy(rng.normal(size=10).clip(-2, 2))
    plain = body.template(shape)
    outfit = random_outfit(rng)
    figure = wardrobe.dress(actor_figure(Actor(plain), _TEXTURE), outfit, rng)
    skirt = random_skirt(rng) if skirted else None
    if skirt is not None:
        width = figure.texture.shape[1]
        across = np.abs(np.mgrid[:_CLOTH, :width]).reshape(2, -1).T / np.array([_CLOTH, width])
        places = np.concatenate([0.8 * across[:, 1:], 0.7 * across[:, :1], 0 * across[:, :1]], 1)
        paint = random_outfit(rng).paints[int(rng.integers(3, 5))]
        cloth = paint.at(places.astype(np.float32), rng).reshape(_CLOTH, width, 3)
        below = cloth.clip(0, 255).astype(np.uint8)
        figure = replace(figure, texture=np.concatenate([figure.texture, below]))
    return Dressed(figure, skirt, Actor(_template(plain, figure, skirt)))


def _template(plain: Template, figure: Figure, skirt: Skirt | None) -> Template:
    """What somebody would have scanned: the clothed person at rest, skinned as plain bodies are."""
    welded, _ = plain.weld()
    vertices = figure.vertices.double().numpy()[welded]
    faces, weights, bones = plain.faces, plain.weights, plain.weight_bones
    if skirt is not None:
        at = dict(zip(LANDMARKS, figure.landmarks, strict=True))
        hips = 0.5 * (at["l_hip"] + at["r_hip"])
        cloth = hang(skirt, figure, figure.vertices, hips, torch.eye(3)).double().numpy()
        faces = np.concatenate([faces, skirt_mesh()[0].numpy() + len(vertices)])
        vertices = np.concatenate([vertices, cloth])
        shares, own = _skirt_weights(plain, cloth - hips.double().numpy())
        weights = np.concatenate([weights, shares])
        bones = np.concatenate([bones, own])
    return replace(
        plain,
        vertices=vertices,
        faces=faces,
        weights=weights,
        weight_bones=bones,
        uv=None,
        texture=None,
        texture_mime=None,
        name="staged",
    )


def _skirt_weights(
    plain: Template, cloth: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Weights (K, 4) and bones of a skirt about the hips: from the pelvis over to the thighs."""
    bones = [plain.bone_names.index(name) for name in ("pelvis", "l_hip", "r_hip")]
    held = np.clip(1 + cloth[:, 1] / _HELD, 0, 1)
    side = np.clip(0.5 + cloth[:, 0] / _SIDES, 0, 1)
    left = side * side * (3 - 2 * side)
    shares = np.stack([held, (1 - held) * left, (1 - held) * (1 - left), 0 * held], -1)
    return shares, np.tile(np.array([*bones, 0]), (len(cloth), 1))


def _texture_places(figure: Figure, skirted: bool) -> tuple[Tensor, Tensor]:
    """Corners of the texture (N, 2), and those of each face (T, 3)."""
    if not skirted:
        return figure.uv, figure.faces_uv
    height = figure.texture.shape[0]
    body = figure.uv * torch.tensor([1.0, (height - _CLOTH) / height])
    low, high = (height - _CLOTH + 2) / height, (height - 2) / height
    faces, uv = skirt_mesh()
    cloth = uv * torch.tensor([1.0, high - low]) + torch.tensor([0.0, low])
    return torch.cat((body, cloth)), torch.cat((figure.faces_uv, faces + len(body)))


def _film(
    path: Path,
    person: Dressed,
    drawn: Sequence[Tensor],
    joints: Tensor,
    cameras: Camera,
    rng: np.random.Generator,
) -> Mask:
    """Draw, and return the true masks (F, H, W)."""
    lighting = random_lights(rng)
    room = furnished(joints, cameras, rng)
    texture, faces, grain = person.texture, person.faces, rng.uniform(0.5, 5)
    breath = 1 + 0.03 * shake(len(drawn), rng, RATE)[:, 0].numpy() * (rng.random() < 0.5)
    empty, masks = None, []
    with VideoWriter(path, RATE) as writer:
        for frame, surface in enumerate(drawn):
            camera = one_camera(cameras, frame)
            if empty is None or cameras.moving:
                empty, floor = empty_room(room, camera, lighting)
            dark = shade_ground(empty, camera, surface, faces, lighting, sun=3, sky=6)
            behind = torch.where(floor[..., None], dark, empty)
            mesh = ProjectedMesh.seen_by(camera, surface, faces)
            reached = visibility(surface, faces, lighting, 1, 6)
            shown = render(mesh, texture, behind, lighting, reached)
            noise = rng.normal(0, grain, (*camera.size[0], 1))
            image = breath[frame] * shown.image.reshape(*camera.size[0], 3).numpy() + noise
            writer.write(np.ascontiguousarray(image.clip(0, 255).astype(np.uint8)))
            masks.append((shown.coverage.reshape(camera.size[0]) >= 0.5).numpy())
    return np.stack(masks)


def _detections(joints: Tensor, cameras: Camera, rng: np.random.Generator) -> Detections:
    """2D joints as detectors err, and 3D poses with noise that stays for some frames."""
    generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
    local = cameras.to_camera(joints)[:, 0]
    pixels = cameras.project(joints)[:, 0]
    unit = 0.01 * (pixels[..., 1].amax(-1) - pixels[..., 1].amin(-1)).quantile(0.9)
    units = unit.expand(1, len(joints))
    found, confidence = corrupt(pixels[None], units, DetectorNoise(), generator)
    noise = torch.zeros_like(local)
    size = torch.tensor([_NOISE, _NOISE, _DEPTH_NOISE], dtype=torch.float64)
    for frame in range(len(local)):
        fresh = torch.randn(local.shape[1:], generator=generator, dtype=torch.float64)
        past = _KEPT * noise[frame - 1] if frame else torch.zeros_like(fresh)
        noise[frame] = past + (math.sqrt(1 - _KEPT**2) if frame else 1.0) * fresh
    poses = local - mid_hip(local).unsqueeze(-2) + size * noise
    return Detections.from_joints(found[0][:, None], confidence[0][:, None], poses[:, None])
