"""Silhouettes as files: written by a capture, made by somebody else, or drawn by hand."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.draw import polygon2mask

from perfcap.errors import InputError
from perfcap.io.atomic import unwritable, writing
from perfcap.io.clip import Clip
from perfcap.io.files import TEXT_LIMIT, natural_key, read_json
from perfcap.io.image_file import SUFFIXES, decode_image, image_size
from perfcap.io.view_names import rows_of

_FILE = re.compile(r"\d{6,}\.png")
_PLAIN = re.compile(r"\w[\w .-]{0,99}")  # names of views that can be names of folders
_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def save_masks(
    folder: Path,
    views: Mapping[str, Iterable[bytes]],
    start: int = 0,
    numbers: Sequence[Sequence[int]] | None = None,
) -> int:
    """Write encoded masks as ``000000.png`` ..., each complete or not at all.

    One view lies in the folder itself, several in folders of their names. Masks that an older run
    left behind are removed first; other files are left alone.

    Args:
        folder: made if missing.
        views: one encoded PNG a frame, by the view's name: 0 background, k person.
        start: number of the first frame.
        numbers: of the frames of each view, C of F, where these are not those from ``start`` on:
            masks of a view that is late are of its own frames. Those below 0 are not written.

    Returns:
        Number of files.

    Raises:
        InputError: the folder cannot be written, or an image is no PNG.
    """
    if folder.is_symlink():
        raise _elsewhere(folder)
    remove_masks(folder)
    rows: Sequence[Iterable[int]] = numbers or [count(start) for _ in views]
    return sum(
        _save_view(folder / name, images, own)
        for name, images, own in zip(view_folders(list(views)), views.values(), rows, strict=True)
    )


def view_folders(views: list[str]) -> list[str]:
    """Folder of each view below ``masks``: its name, or its number where that is no plain name."""
    if len(views) == 1:
        return ["."]
    return [n if _PLAIN.fullmatch(n) else f"view_{i}" for i, n in enumerate(views)]


def holds_masks(folder: Path) -> bool:
    """Whether there are files that ``remove_masks`` would remove; not behind a link."""
    if folder.is_symlink() or not folder.is_dir():
        return False
    inner = [entry for entry in folder.iterdir() if entry.is_dir() and not entry.is_symlink()]
    found = (entry for place in (folder, *inner) for entry in place.iterdir())
    return any(_FILE.fullmatch(entry.name) and not entry.is_dir() for entry in found)


def remove_masks(folder: Path, kept: Collection[str] = ()) -> None:
    """Remove masks from a folder and from the folders in it, then those of them that are empty.

    Files of other names stay, and links to other folders are not followed: not even ``folder``.

    Args:
        folder: with masks, or folders of them.
        kept: masks that stay, relative to ``folder``.

    Raises:
        InputError: a file cannot be removed.
    """
    if folder.is_symlink():
        return
    try:
        inner = [entry for entry in folder.iterdir() if entry.is_dir() and not entry.is_symlink()]
        for place in (*inner, folder):
            for entry in list(place.iterdir()):
                is_mask = _FILE.fullmatch(entry.name) and not entry.is_dir()
                if is_mask and entry.relative_to(folder).as_posix() not in kept:
                    entry.unlink()
            with suppress(OSError):  # holds something else
                place.rmdir()
    except FileNotFoundError:
        return
    except OSError as error:
        raise unwritable(folder, error) from error


def _save_view(folder: Path, images: Iterable[bytes], numbers: Iterable[int]) -> int:
    if folder.is_symlink():
        raise _elsewhere(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    written = 0
    for data, number in zip(images, numbers, strict=False):  # some count on and on
        if not data.startswith(_SIGNATURE):
            raise InputError(f"{folder}: mask of frame {number} is not an encoded PNG")
        if number >= 0:
            with writing(folder / f"{number:06d}.png") as file:
                file.write(data)
            written += 1
    return written


def _elsewhere(folder: Path) -> InputError:
    return InputError(f"{folder}: is a link to another folder, where nothing is written; remove it")


# --- Silhouettes drawn by hand: outlines of frames as JSON, made by ``tools/label_masks.py`` ------

Polygons = list[NDArray[np.float64]]


def read_labels(path: str | Path, size: tuple[int, int]) -> dict[int, Polygons]:
    """Outlines (N, 2) of each labelled frame, pixels with centres at integers.

    Args:
        path: ``{"size": [H, W], "frames": {"12": [[[x, y], ...], ...]}}``.
        size: height and width of the images to label, px.

    Raises:
        InputError: another format, or labels of images of another size.
    """
    data = read_json(Path(path), "hand-drawn outlines", TEXT_LIMIT)
    found = data.get("size") if isinstance(data, dict) else type(data).__name__
    if found != list(size):
        raise InputError(f"{path}: is for images of size {found}; expected {list(size)}")
    frames = data.get("frames")
    if not isinstance(frames, dict) or not all(key.isdecimal() for key in frames):
        raise InputError(f"{path}: has no outlines by frame number; expected a 'frames' object")
    return {int(key): [_polygon(path, key, line) for line in frames[key]] for key in frames}


def _polygon(path: str | Path, frame: str, line: Any) -> NDArray[np.float64]:
    try:
        points = np.array(line, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3 or not np.isfinite(points).all():
        raise InputError(
            f"{path}: frame {frame} has an outline of shape {points.shape}; expected three or "
            "more finite points [x, y]"
        )
    return points


def fill(polygons: Polygons, size: tuple[int, int]) -> NDArray[np.bool_]:
    """The pixels whose centres lie inside an odd number of outlines, (H, W)."""
    mask = np.zeros(size, bool)
    for polygon in polygons:
        mask ^= polygon2mask(size, polygon[:, ::-1])
    return mask


# --------------------------------------------------------------------------------------------------
# Masks of the person that somebody else made, of some frames or all: a folder of images a view.

Mask = NDArray[np.bool_]

_NUMBER = re.compile(r".*?([0-9]{1,18})")
_HEADER = 1 << 16  # bytes in which an image says its size
_WHITE = 0.75  # of the greatest value: what reaches it is white on black, below are labels
_LABELS = 32  # more of them are shades


@dataclass(frozen=True)
class MaskFolders:
    """Masks of some frames of a clip.

    As many images as the video has frames are those of its frames, in order. Fewer are those of
    the images that are called like them, or of the frames that the numbers at the ends of their
    names say, as captures write them: the first frame of the video is 0. Those of a view that is
    late are of the frames of its own video.

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
            size, first = clip.sizes[view], clip.start + clip.late(view)
            numbered = _numbered(folder, clip.sources[view].total, clip.image_names[view])
            own = {number - first: path for number, path in numbered.items()}
            own = {frame: path for frame, path in own.items() if 0 <= frame < len(clip)}
            if not own:
                raise InputError(
                    f"--masks {folder}: holds images {min(numbered)} to {max(numbered)}, none of "
                    f"the frames {max(first, 0)} to {first + len(clip) - 1} that are captured; "
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


def _numbered(folder: Path, total: int | None, names: Sequence[str]) -> dict[int, Path]:
    """Images by the frame of the video that they belong to.

    Names of the video's own images say it, unless they may be those that a capture writes.
    """
    if not folder.is_dir():
        raise InputError(f"--masks {folder}: no such folder; expected a folder of images a view")
    images = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.name[0] != "."]
    if not images:
        raise InputError(f"--masks {folder}: holds no images; expected PNG files")
    images.sort(key=lambda path: natural_key(path.name))
    if len(images) == total:
        rows = rows_of([path.stem for path in images], names)
        return dict(zip(rows or range(total), images, strict=True))
    ours = all(_FILE.fullmatch(path.name) for path in images)
    if rows := [] if ours else rows_of([path.stem for path in images], names):
        return dict(zip(rows, images, strict=True))
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
    if top >= _WHITE * full:
        return _above(image, top / 2)
    # shares of a matting network that is nowhere sure, rather than numbers of people or parts
    shades = len(np.unique(image[image > 0])) > _LABELS
    return _above(image, full / 2 if shades else 0)


def _above(image: NDArray[Any], limit: float) -> Mask:
    inside: Mask = image > limit
    return inside


def _odd_size(path: Path, found: tuple[int, int], size: tuple[int, int]) -> InputError:
    return InputError(
        f"--masks {path}: is {found[1]}x{found[0]}, its video is {size[1]}x{size[0]}; expected "
        "masks in the pixels of the video"
    )
