"""A folder of images as a clip's frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.files import natural_key
from perfcap.io.image_file import decode_image

Frames = NDArray[np.uint8]

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})


class ImageFolder:
    """Images in the natural order of their names (``2.png`` before ``10.png``), one size.

    Files of other kinds and hidden files are passed over. Images have no times: ``fps`` is None.
    """

    fps: None = None
    timestamps: None = None
    lost: int = 0
    warnings: tuple[str, ...] = ()

    def __init__(self, path: Path, stop: int | None = None) -> None:
        """List the first ``stop`` images, or all.

        Raises:
            InputError: no images, or a first image that cannot be read.
        """
        files = [
            entry
            for entry in path.iterdir()
            if entry.suffix.lower() in SUFFIXES and not entry.name.startswith(".")
        ]
        if not files:
            raise InputError(
                f"{path}: holds no images; expected a video, or a folder of PNG or JPEG frames"
            )
        self.path = path
        self.name = path.name
        self.files = sorted(files, key=lambda file: natural_key(file.name))[:stop]
        self.total: int | None = len(files)
        first = read_image(self.files[0])
        self.size: tuple[int, int] = (first.shape[0], first.shape[1])

    def __len__(self) -> int:
        return len(self.files)

    def read(self, start: int, stop: int) -> Frames:
        """Images ``start`` to ``stop`` as RGB, (stop - start, H, W, 3)."""
        if not 0 <= start <= stop <= len(self):
            raise IndexError(f"{self.path}: frames {start}:{stop} of {len(self)}")
        frames = np.empty((stop - start, *self.size, 3), np.uint8)
        for i, file in enumerate(self.files[start:stop]):
            image = read_image(file)
            if image.shape[:2] != self.size:
                raise InputError(
                    f"{file}: is {image.shape[1]}x{image.shape[0]}, the first image is "
                    f"{self.size[1]}x{self.size[0]}; expected one size"
                )
            frames[i] = image
        return frames

    def close(self) -> None:
        """Nothing is held open."""


def read_image(path: Path) -> Frames:
    """An image as 8-bit RGB (H, W, 3), turned as its EXIF orientation says.

    Raises:
        InputError: a file that is empty, too large or no image.
    """
    image = decode_image(path, cv2.IMREAD_COLOR)
    return np.ascontiguousarray(image[..., ::-1])
