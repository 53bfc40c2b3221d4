"""An actor on one picture: from all sides, by what moves it, and through its range of motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.io.atomic import writing
from perfcap.pipeline.appearance import Appearance
from perfcap.pipeline.camera_path import orbit
from perfcap.pipeline.free_view import Studio
from perfcap.pipeline.objective import neutral_angles
from perfcap.pipeline.surroundings import Surroundings
from perfcap.render import Texture, draw_caption
from perfcap.render.backdrop import Backdrop
from perfcap.render.texture import to_srgb

Image = NDArray[np.uint8]

_LARGE, _SMALL = 480, 320  # px, sides of the pictures of the rows of four and of six
_CLOSER = 1.15  # the orbiting camera leaves room that a rest pose does not need
_VIEWS = ("front", "its left", "back", "its right")
_AROUND, _ASIDE = 24, 3  # poses are seen from 3/24 of a turn to the person's left
_QUALITY = 90

# degrees of angles that differ from standing; ``pitch`` leans all of the body forwards
POSES: Mapping[str, Mapping[str, float]] = {
    "arms up": {"shoulder_elevation": 165, "elbow_flexion": 10},
    "squat": {
        "hip_flexion": 105, "knee_flexion": 115, "ankle_dorsiflexion": 25, "hip_abduction": 15,
        "pitch": 25, "spine_flexion": 10, "shoulder_elevation": 75, "shoulder_horizontal": 50,
    },
    "kick": {
        "r_hip_flexion": 85, "r_knee_flexion": 10, "l_shoulder_elevation": 70,
        "l_shoulder_horizontal": 40, "r_shoulder_elevation": 40, "spine_flexion": 10,
    },
    "twist": {"spine_axial": 40, "neck_axial": 45, "shoulder_elevation": 85, "elbow_flexion": 30},
    "bow": {"pitch": 50, "hip_flexion": 50, "spine_flexion": 40, "neck_flexion": 20},
    "run": {
        "pitch": 10, "l_hip_flexion": 65, "l_knee_flexion": 85, "r_hip_flexion": -15,
        "r_knee_flexion": 45, "elbow_flexion": 90, "r_shoulder_elevation": 55,
        "r_shoulder_horizontal": 50, "l_shoulder_elevation": -40,
    },
}  # fmt: skip


def save_sheet(actor: Actor, path: Path) -> None:
    """Draw the contact sheet into a JPEG file.

    Raises:
        InputError: the place cannot be written, or the texture not be decoded.
    """
    picture = contact_sheet(actor)
    encoded = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    with writing(path) as file:
        file.write(encoded.tobytes())


def contact_sheet(actor: Actor) -> Image:
    """Four textured views, four with weights in the colours of joints, six poses, (H, W, 3)."""
    look = Appearance.of(actor.template)
    weights = replace(look, texture=weight_colors(actor))
    rest = actor.skeleton.rest_motion()
    rows = []
    for each in (look, weights):
        around = _pictures(actor, each, rest, (0, 6, 12, 18), _LARGE, _CLOSER)
        rows.append([draw_caption(*pair) for pair in zip(around, _VIEWS, strict=True)])
    poses = []
    for name, degrees in POSES.items():
        (picture,) = _pictures(actor, look, pose(actor, degrees), (_ASIDE,), _SMALL)
        poses.append(draw_caption(picture, name))
    return np.concatenate([np.concatenate(row, axis=1) for row in (*rows, poses)])


def pose(actor: Actor, degrees: Mapping[str, float]) -> Motion:
    """Standing with some angles changed, within the limits, feet on the ground, (1,).

    Args:
        actor: who is posed.
        degrees: by name of the angle; without ``l_`` or ``r_`` of both sides.
    """
    angles = neutral_angles(actor).clone()
    for index, name in enumerate(actor.skeleton.angle_names):
        for key in (name[2:] if name[:2] in ("l_", "r_") else name, name):
            if key in degrees:
                angles[index] = math.radians(degrees[key])
    angles = angles.clamp(actor.skeleton.lower, actor.skeleton.upper)
    pitch = angles.new_tensor([[math.radians(degrees.get("pitch", 0.0)), 0.0, 0.0]])
    rest = actor.skeleton.rest_motion()
    motion = Motion(rest.translation, pitch, angles[None])
    lift = actor.surface(motion)[..., 1].min()
    return replace(motion, translation=motion.translation - lift * torch.eye(3).to(lift)[1])


def weight_colors(actor: Actor) -> Texture:
    """Faces in the colours of the joints that move them, mixed as their weights are."""
    bones, shares, _ = actor.skin.rows()
    colors = _palette(len(actor.skeleton.rig.joints))[bones]  # V K 3
    faces = torch.tensor(actor.template.faces)
    mixed = (shares[..., None].float() * colors).sum(1)[faces].mean(1)
    side = math.ceil(math.sqrt(len(faces)))
    image = torch.zeros(side * side, 3, dtype=torch.uint8)
    image[: len(faces)] = to_srgb(mixed)
    # a texel for each face, looked up at its middle
    texel = torch.arange(len(faces))
    middle = torch.stack(((texel % side + 0.5) / side, (texel // side + 0.5) / side), -1)
    corners = texel[:, None].expand(-1, 3)
    return Texture.from_image(image.view(side, side, 3), middle, corners)


def _palette(count: int) -> Tensor:
    """Linear colours that neighbours in a chain of joints do not share, (J, 3)."""
    hue = torch.arange(count) * 0.381966 % 1.0  # steps of the golden angle
    value = 0.55 + 0.45 * (torch.arange(count) % 2)
    wheel = (hue[:, None] * 6 + torch.tensor([0.0, 4.0, 2.0])) % 6
    color: Tensor = value[:, None] * ((wheel - 3).abs() - 1).clamp(0.06, 1)
    return color


def _pictures(
    actor: Actor,
    look: Appearance,
    motion: Motion,
    steps: Sequence[int],
    size: int,
    closer: float = 1.0,
) -> list[Image]:
    """Square pictures of one pose from steps of a way around it, ``_AROUND`` a turn."""
    up, ahead = torch.eye(3, dtype=torch.float64)[[1, 2]]
    vertices = actor.surface(motion)[0].detach().double()
    ground = vertices[:, 1].min()
    around = Surroundings(up, ahead, float(ground))
    middle = vertices.mean(0)
    backdrop = Backdrop(up, middle + (ground - middle @ up) * up)
    moment = Studio(look, around, backdrop).at(vertices)
    joints = actor.joints(motion).double()
    wide = round(closer * size)
    path = orbit(joints, around, [0] * _AROUND, (wide, wide), 1.0)
    inner = slice((wide - size) // 2, (wide - size) // 2 + size)
    return [moment.seen_by(path.camera(step))[inner, inner] for step in steps]
