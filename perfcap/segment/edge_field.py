"""Edges of an image as contours want to meet them: strength and direction, without polarity."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_picture
from perfcap.setting_checks import Settings

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class EdgeSettings(Settings):
    """How edges are found.

    Attributes:
        blur: deviation of the Gaussian before derivatives, px.
        clamp: gradient that counts in full, of intensities from 0 to 1 over a pixel, channels
            summed: a stronger edge is no better.
        low: gradient below which a pixel is flat, and costs what it lacks.
    """

    blur: float = 1.1
    clamp: float = 0.2
    low: float = 0.1


@dataclass(frozen=True)
class EdgeField:
    """What a contour gains or pays in each pixel of a part of an image.

    Attributes:
        edges: cosine and sine of twice the direction of the gradient, times its strength,
            (2, h, w).
        flat: price of a unit of contour, (h, w).
        corner: row and column of the first pixel in the image.
    """

    edges: Floats
    flat: Floats
    corner: tuple[int, int]


def find_edges(
    image: NDArray[np.uint8],
    settings: EdgeSettings | None = None,
    corner: tuple[int, int] = (0, 0),
) -> EdgeField:
    """Edges of an RGB picture (h, w, 3).

    Args:
        image: of at least one pixel.
        settings: how.
        corner: where the picture begins in the image it is cut from.

    Raises:
        InputError: it is no RGB picture in bytes.
    """
    require_picture(image, "image")
    settings = settings or EdgeSettings()
    smooth = cv2.GaussianBlur(image.astype(np.float32) / 255, (0, 0), settings.blur)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *axis, ksize=3) / 8 for axis in ((1, 0), (0, 1)))
    # of the structure tensor: channels that see an edge with opposite signs do not cancel
    cosine, sine = (gx * gx - gy * gy).sum(-1), 2 * (gx * gy).sum(-1)
    squared = np.sqrt(cosine * cosine + sine * sine)
    # three channels that agree add up to this
    strength = np.minimum(np.sqrt(3 * squared), settings.clamp)
    share = strength / np.maximum(squared, 1e-12)
    return EdgeField(
        np.stack((cosine * share, sine * share)),
        np.maximum(settings.low - strength, 0),
        corner,
    )


def shrunk(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """A picture averaged to another height and width, as it is where that is its own."""
    if image.shape[:2] == size:
        return image
    return np.asarray(cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA), np.uint8)
