"""Silhouettes from image files, one a frame."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.io.image_file import decode_image

_WHAT = "an image of a silhouette"
_HALF = 127


def read_silhouette(path: Path, person: int | None = None) -> NDArray[np.bool_]:
    """Where an image shows somebody, (H, W).

    Args:
        path: an image; of several channels their mean counts.
        person: value of the person in a map of labels; without it, what is brighter than half.

    Raises:
        InputError: it is missing, too large, or no image.
    """
    image = decode_image(path, cv2.IMREAD_GRAYSCALE, _WHAT)
    found: NDArray[np.bool_] = image > _HALF if person is None else image == person
    return found
