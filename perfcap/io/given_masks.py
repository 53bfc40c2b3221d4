"""Masks of the person that somebody else made, of some frames or all: a folder of images a view."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.clip import Clip
from perfcap.io.files import natural_key
from perfcap.io.image_file import decode_image, image_size
from perfcap.io.image_folder import SUFFIXES
from perfcap.io.late_source import LateSource

Mask = NDArray[np.bool_]

_NUMBER = re.compile(r".*?([0-9]{1,18})")
_HEADER = 1 << 16  # bytes in which an image says its size
_WHITE = 0.75  # of the greatest value: what reaches it is white on black, below are labels


@dataclass(frozen=True)
class MaskFolders:
    """Masks of some frames of a clip.

    As many images as the video has frames are those of its frames, in order. Fewer are those of
    the frames that the numbers at the ends of their names say, as captures write them: the first
    frame of the video is 0.

    Attributes:
        files: of each view, C, by the frame of the clip.
        sizes: image (height, width) a view.
    """

    files: tuple[dict[int, Path], ...]
    sizes: tuple[tuple[int, int], ...]

    @classmethod
    def open(cls, folders: Sequence[Path], clip: Clip) -> Self:
        """Find the images that belong to the frames of a clip.

        Raises:
            InputError: other numbers of views, no images of its frames, names without numbers
                where frames are missing, or images of another size than the videos'.
        """
        if len(folders) != clip.views:
            raise InputError(
                f"--masks: are {len(folders)} folders, expected one for each of {clip.views} views"
            )
        files = []
        for view, folder in enumerate(folders):
            source, size = clip.sources[view], clip.sizes[view]
            late = source.late if isinstance(source, LateSource) else 0
            numbered = _numbered(folder, source.total)
            own = {n - late - clip.start: path for n, path in numbered.items()}
            own = {frame: path for frame, path in own.items() if 0 <= frame < len(clip)}
            if not own:
                raise InputError(
                    f"--masks {folder}: holds images {min(numbered)} to {max(numbered)}, none of "
                    f"the frames {clip.start} to {clip.start + len(clip) - 1} that are captured; "
                    "expected images numbered as the frames of the video, the first is 0"
                )
            for path in own.values():
                _require_size(path, size)
            files.append(dict(sorted(own.items())))
        return cls(tuple(files), clip.sizes)

    def knows(self, view: int, frame: int) -> bool:
        """Whether there is a mask of a frame."""
        return frame in self.files[view]

    def mask(self, view: int, frame: int) -> Mask | None:
        """Where the person is in a frame, (H, W); None if nobody says."""
        path = self.files[view].get(frame)
        return None if path is None else _read(path, self.sizes[view])

    def complete(self) -> list[int]:
        """Frames with a mask in every view, increasing."""
        return sorted(set.intersection(*(set(view) for view in self.files)))


def _numbered(folder: Path, total: int | None) -> dict[int, Path]:
    """Images by the frame of the video that they belong to."""
    if not folder.is_dir():
        raise InputError(f"--masks {folder}: no such folder; expected a folder of images a view")
    images = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.name[0] != "."]
    if not images:
        raise InputError(f"--masks {folder}: holds no images; expected PNG files")
    images.sort(key=lambda path: natural_key(path.name))
    if len(images) == total:
        return dict(enumerate(images))
    found = [_NUMBER.fullmatch(path.stem) for path in images]
    numbers = [int(match[1]) for match in found if match is not None]
    of_how_many = "" if total is None else f" of {total} frames"
    if len(set(numbers)) < len(images):
        raise InputError(
            f"--masks {folder}: holds {len(images)} images{of_how_many} that are not numbered one "
            "by one; expected an image of every frame, or names that end with the number of their "
            "frame, the first is 0"
        )
    if total is not None and numbers[-1] >= total:
        raise InputError(
            f"--masks {folder}: holds an image {images[-1].name} of a video of {total} frames; "
            "expected numbers from 0, the first frame"
        )
    return dict(zip(numbers, images, strict=True))


def _require_size(path: Path, size: tuple[int, int]) -> None:
    try:
        with path.open("rb") as file:
            found = image_size(file.read(_HEADER))
    except OSError as error:
        raise InputError(f"--masks {path}: cannot be read ({error.strerror})") from error
    if found is not None and (found[1], found[0]) != size:
        raise _odd_size(path, (found[1], found[0]), size)


def _read(path: Path, size: tuple[int, int]) -> Mask:
    image = decode_image(path, cv2.IMREAD_UNCHANGED, "a mask")
    if image.shape[:2] != size:
        raise _odd_size(path, (image.shape[0], image.shape[1]), size)
    if image.ndim == 3:
        cut_out = image.shape[2] == 4 and np.ptp(image[..., 3]) > 0
        image = image[..., 3] if cut_out else image[..., :3].max(-1)
    top = float(image.max())
    full = float(np.iinfo(image.dtype).max) if image.dtype.kind == "u" else 1.0
    inside: Mask = image > (top / 2 if top >= _WHITE * full else 0)
    return inside


def _odd_size(path: Path, found: tuple[int, int], size: tuple[int, int]) -> InputError:
    return InputError(
        f"--masks {path}: is {found[1]}x{found[0]}, its video is {size[1]}x{size[0]}; expected "
        "masks in the pixels of the video"
    )
