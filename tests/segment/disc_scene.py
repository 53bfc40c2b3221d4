"""A textured disc, standing for a person, on a textured background, with known truth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

SIZE = 150
RADIUS = 34.0


@dataclass(frozen=True)
class DiscClip:
    """Frames (F, H, W, 3), true and modelled masks (F, H, W), bones (F, 1, 2, 2)."""

    images: NDArray[np.uint8]
    truth: NDArray[np.bool_]
    models: NDArray[np.bool_]
    bones: NDArray[np.float64]


def texture(rng, shape, low, high, grain=2.0) -> NDArray[np.float32]:
    """Smooth random colours between two colours."""
    noise = cv2.GaussianBlur(rng.normal(size=(*shape, 3)), (0, 0), grain)
    noise = (noise - noise.min((0, 1))) / np.ptp(noise, (0, 1))
    return (np.asarray(low) + noise * (np.asarray(high) - low)).astype(np.float32)


def disc(center, radius=RADIUS, shape=(SIZE, SIZE)) -> NDArray[np.bool_]:
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return (columns - center[0]) ** 2 + (rows - center[1]) ** 2 <= radius**2


def disc_clip(
    frames=13, seed=0, error=(4.0, -3.0), speed=4.0, person=((140, 40, 40), (250, 120, 110)),
    scene=((40, 90, 60), (120, 180, 150)), pan=0.0, noise=1.5,
) -> DiscClip:  # fmt: skip
    """A disc that moves to the right, and a model that is ``error`` pixels off.

    Args:
        pan: pixels a frame that the camera turns to the left, so that the scene moves right.
    """
    rng = np.random.default_rng(seed)
    wide = SIZE + 2 * int(abs(pan) * frames) + 2
    behind = texture(rng, (SIZE, wide), *scene)
    front = texture(rng, (SIZE, 3 * SIZE), *person)
    images, truth, models, bones = [], [], [], []
    for frame in range(frames):
        center = np.array([SIZE / 2 + speed * (frame - frames // 2), SIZE / 2 + 2])
        start = round(wide / 2 - SIZE / 2 - pan * (frame - frames // 2))
        image = behind[:, start : start + SIZE].copy()
        mask = disc(center)
        left = round(SIZE - center[0] + SIZE / 2)
        image[mask] = front[:, left : left + SIZE][mask]
        image += rng.normal(scale=noise, size=image.shape)
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
        truth.append(mask)
        models.append(disc(center + error))
        bones.append([[center + error - [0, 15], center + error + [0, 15]]])
    return DiscClip(*(np.array(part) for part in (images, truth, models, bones)))


def overlap(one, other) -> float:
    """Intersection over union."""
    return float((one & other).sum() / max((one | other).sum(), 1))
