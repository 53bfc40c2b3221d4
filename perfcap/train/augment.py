"""Stored crops as a network sees them: zoomed, turned, mirrored, spoiled."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.joint_set import LANDMARKS16
from perfcap.detect.viewing_ray import toward
from perfcap.train.body_parts import mirrored_parts, part_map_size
from perfcap.train.config import Augmentation
from perfcap.train.scenes import Shot

Picture = NDArray[np.uint8]
Floats = NDArray[np.float32]

_MIRRORED = list(LANDMARKS16.mirrored())
FOLLOWED = 1.25 * 1.16  # boxes around the joints in the crop that a person is followed with
_OTHER_SIDE = mirrored_parts()
_LUMA = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True, eq=False)
class View:
    """What is shown of a shot.

    Attributes:
        image: (size, size, 3) RGB.
        joints2d: pixels of the image, (16, 2).
        joints3d: root-relative, axes of the ray through the image's middle, (16, 3) m.
        inside: joints that lie in the image, (16,); none without a person.
        known: joints of which it is known whether and where they are inside, (16,).
        posed: whether 3D positions are known.
        parts: of the body at each pixel of the maps, (size/4, size/4), indices in ``PARTS``.
    """

    image: Picture
    joints2d: Floats
    joints3d: Floats
    inside: NDArray[np.bool_]
    known: NDArray[np.bool_]
    posed: bool
    parts: Picture


@dataclass(frozen=True)
class Framing:
    """Where to cut from a shot.

    Attributes:
        zoom: against the size at which a person is followed.
        turn: rad.
        shift: of the middle, in sizes of the crop.
        mirror: left and right exchanged.
        black: whether nothing is beyond the shot, rather than its mirror image.
    """

    zoom: float = 1.0
    turn: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    mirror: bool = False
    black: bool = False


def random_framing(settings: Augmentation, rng: np.random.Generator) -> Framing:
    """A random cut."""
    low, high = np.log(settings.zoom)
    zoom = float(np.exp(rng.uniform(low, high)))
    if rng.random() < settings.small:
        zoom = float(rng.uniform(settings.smallest, settings.zoom[0]))
    right, down = (settings.shift * rng.normal(size=2)).clip(-0.3, 0.3)
    return Framing(
        zoom=zoom,
        turn=float(np.radians(settings.turn * np.clip(rng.normal(), -2.5, 2.5))),
        shift=(float(right), float(down)),
        mirror=bool(rng.random() < 0.5),
        black=bool(rng.random() < 0.3),
    )


def cut(shot: Shot, framing: Framing, size: int, margin: float) -> View:
    """A part of a shot.

    Args:
        shot: stored; its camera looks at its middle.
        framing: where to cut.
        size: of the part, pixels.
        margin: width of the shot, in boxes around the joints.
    """
    image, joints, poses, parts = shot.image, shot.joints2d, shot.joints3d, shot.parts
    side = len(image)
    if framing.mirror:
        image, parts = image[:, ::-1], _OTHER_SIDE[parts[:, ::-1]]
        joints = np.stack([side - 1 - joints[_MIRRORED, 0], joints[_MIRRORED, 1]], -1)
        poses = poses[_MIRRORED] * np.array([-1, 1, 1], np.float32)
    width = side * FOLLOWED / margin / framing.zoom
    cos, sin = np.cos(framing.turn), np.sin(framing.turn)
    scale = width / size
    back = scale * np.array([[cos, sin], [-sin, cos]])  # pixels of the part to those of the shot
    center = 0.5 * (side - 1) + width * np.array(framing.shift)
    origin = center - back @ np.full(2, 0.5 * (size - 1))
    beyond = cv2.BORDER_CONSTANT if framing.black else cv2.BORDER_REFLECT_101
    part = cv2.warpAffine(
        image,
        np.concatenate([back, origin[:, None]], 1),
        (size, size),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=beyond,
    )
    coarse = part_map_size(size)
    # of pixels whose corner is the origin, all of it scales
    corner = (origin + 0.5 - back @ np.full(2, 0.5)) * len(parts) / side
    step = back * (len(parts) / side) * (size / coarse)
    shown = cv2.warpAffine(
        parts,
        np.concatenate([step, (corner - 0.5 + step @ np.full(2, 0.5))[:, None]], 1),
        (coarse, coarse),
        flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
        borderMode=beyond,
    )
    points = (joints - origin) @ np.linalg.inv(back).T
    ray = torch.from_numpy((center - 0.5 * (side - 1)) / shot.focal)
    local = poses @ toward(ray).numpy()
    local[:, :2] = local[:, :2] @ np.array([[cos, sin], [-sin, cos]])
    inside = ((points > -0.5) & (points < size - 0.5)).all(-1) & shot.present
    known = np.isfinite(joints).all(-1) | np.full(len(joints), not shot.present)
    return View(
        np.asarray(part, np.uint8),
        np.nan_to_num(points).astype(np.float32),
        np.nan_to_num(local).astype(np.float32),
        inside & known,
        known,
        bool(np.isfinite(local).all()),
        np.asarray(shown, np.uint8),
    )


def spoil(image: Picture, settings: Augmentation, rng: np.random.Generator) -> Picture:
    """Other colours and light, blur, noise, compression, and parts that are covered."""
    image = _recolored(image, settings, rng)
    if rng.random() < settings.cut:
        _cover(image, rng)
    size = len(image)
    if rng.random() < settings.blur:
        sigma = rng.uniform(0.3, 1.3) * size / 128
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), sigma), np.uint8)
    if rng.random() < settings.noise:
        noise = rng.standard_normal(image.shape, np.float32) * np.float32(rng.uniform(2, 11))
        image = (image + noise).clip(0, 255).astype(np.uint8)
    if rng.random() < settings.jpeg:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(15, 70))]
        _, code = cv2.imencode(".jpg", image, quality)
        image = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)
    return image


def _recolored(image: Picture, settings: Augmentation, rng: np.random.Generator) -> Picture:
    """Saturation, hue, and a curve for each channel."""
    amount = 0.0 if rng.random() < settings.grey else rng.uniform(0.5, 1.35)
    grey = np.tile(_LUMA, (3, 1))
    mix = grey + amount * (np.eye(3) - grey)
    mix = mix + rng.normal(0, 0.04, (3, 3))
    mixed = cv2.transform(image, mix.astype(np.float32))
    level = np.linspace(0, 1, 256)[:, None]
    gamma = np.exp(rng.normal(0, 0.25) + rng.normal(0, 0.06, 3))
    gain = np.exp(rng.normal(0, 0.12) + rng.normal(0, 0.06, 3))
    curve = gain * level**gamma + rng.normal(0, 0.03)
    table = (255 * curve).clip(0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(mixed, table[None]), np.uint8)


def _cover(image: Picture, rng: np.random.Generator) -> None:
    """Rectangles and discs of one colour or noise, in place."""
    size = len(image)
    for _ in range(int(rng.integers(1, 4))):
        x, y = (int(v) for v in rng.uniform(0, size, 2))
        wide, high = (max(1, int(v)) for v in size * rng.uniform(0.04, 0.2, 2))
        color = tuple(float(v) for v in rng.uniform(0, 255, 3))
        if rng.random() < 0.5:
            cv2.rectangle(image, (x - wide, y - high), (x + wide, y + high), color, -1)
        else:
            cv2.ellipse(image, (x, y), (wide, high), 0, 0, 360, color, -1)
