"""Rendered people before other backgrounds than they were rendered with.

Pictures of real places are few; people cut out and shown before any part of any of them, in colours
that may be the person's own, teach that a body is a shape. The cut follows the coarse map of parts,
harder or softer each time, so that its edge teaches nothing (Dwibedi et al. 2017, Cut, Paste and
Learn).
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.train.backgrounds import Backgrounds, Picture
from perfcap.train.body_parts import UNKNOWN
from perfcap.train.detector_config import Augmentation
from perfcap.train.scenes import Shot

_FEWEST = 4  # pixels of a part whose colours are taken

Floats = NDArray[np.float32]


def elsewhere(
    shot: Shot, backgrounds: Backgrounds, settings: Augmentation, rng: np.random.Generator
) -> Shot:
    """A shot before another background, or as it is.

    Args:
        shot: as stored; photographs, whose parts are unknown, stay as they are.
        backgrounds: where to; with a folder of pictures.
        settings: how often.
        rng: of everything random.
    """
    if rng.random() >= settings.moved or (shot.parts == UNKNOWN).any():
        return shot
    behind = backgrounds.photograph(len(shot.image), rng).astype(np.float32)
    behind = _recolored(behind, shot, settings, rng)
    opaque = _cut_out(shot.parts, len(shot.image), rng)[..., None]
    image = behind + opaque * (shot.image - behind)
    return replace(shot, image=image.clip(0, 255).astype(np.uint8))


def _cut_out(parts: Picture, size: int, rng: np.random.Generator) -> Floats:
    """How opaque somebody is, (size, size), 0 to 1."""
    mask = cv2.resize((parts > 0).astype(np.float32), (size, size), interpolation=cv2.INTER_CUBIC)
    mask = cv2.GaussianBlur(mask, (0, 0), float(rng.uniform(0.6, 1.6)))
    share = (mask - rng.uniform(0.3, 0.6)) * rng.uniform(2.0, 8.0) + 0.5
    return np.asarray(share.clip(0, 1), np.float32)


def _recolored(
    behind: Floats, shot: Shot, settings: Augmentation, rng: np.random.Generator
) -> Floats:
    """A background in other colours; some have those of a part of the person."""
    present = np.unique(shot.parts[shot.parts > 0])
    if len(present) and rng.random() < settings.camouflaged:
        side = len(shot.parts)
        small = cv2.resize(shot.image, (side, side), interpolation=cv2.INTER_AREA)
        colors = small[shot.parts == rng.choice(present)].astype(np.float32)
        if len(colors) >= _FEWEST:
            few = behind[::4, ::4].reshape(-1, 3)
            contrast = np.float32(rng.uniform(0.5, 1.5)) * few.std()
            shifted = (behind - few.mean(0)) * (contrast / (few.std(0) + 1)) + colors.mean(0)
            return np.asarray(shifted, np.float32)
    gains = np.exp(rng.normal(0, 0.15) + rng.normal(0, 0.08, 3)).astype(np.float32)
    return behind * gains
