"""Images that somebody else made, single ones and folders: of known size before decoding."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice, pairwise
from pathlib import Path
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.exif import jpeg_segments
from perfcap.io.files import MEBIBYTE, VIDEO_SUFFIXES, natural_key, require_file

IMAGE_LIMIT = 256 * MEBIBYTE
_PNG = b"\x89PNG\r\n\x1a\n"
_HALF = 127  # of a silhouette
MOST_PIXELS = 1 << 27  # more than any camera has; a few bytes can declare many times that


def decode_image(path: Path, flags: int, what: str = "an image") -> NDArray[np.uint8]:
    """An image as OpenCV decodes it.

    Args:
        path: the file.
        flags: ``cv2.IMREAD_...``.
        what: it should be, for messages.

    Raises:
        InputError: it is empty, too large, damaged, or no image.
    """
    require_file(path, IMAGE_LIMIT, what)
    data = path.read_bytes()
    if is_damaged_png(data):
        raise InputError(f"{path}: is a damaged PNG; expected {what}, write it again")
    size = image_size(data)
    if size is not None and size[0] * size[1] > MOST_PIXELS:
        raise InputError(
            f"{path}: says it is {size[0]}x{size[1]}, expected at most {MOST_PIXELS >> 20} million "
            "pixels; write it smaller"
        )
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise InputError(f"{path}: cannot be decoded as an image ({error.err})") from error
    if image is None:
        raise InputError(f"{path}: is not an image or is damaged; expected {what}, write it again")
    decoded: NDArray[np.uint8] = image
    return decoded


def is_damaged_png(data: bytes) -> bool:
    """Whether data begin as a PNG whose chunks do not lie within them.

    OpenCV makes room for what a chunk says it has.
    """
    return data[:4] == _PNG[:4] and not _is_whole(data)


def _is_whole(data: bytes) -> bool:
    if data[:8] != _PNG or data[12:16] != b"IHDR":
        return False
    position = 8
    while position + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, position)
        position += 12 + length
        if kind == b"IEND":
            return bool(position <= len(data))
    return False


def image_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that the header of a PNG or JPEG declares, None if it has none."""
    if data[:4] == b"\x89PNG" and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return int(width), int(height)
    for marker, position in jpeg_segments(data):
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # start of a frame
            height, width = struct.unpack_from(">HH", data, position + 5)
            return int(width), int(height)
    return None


# --- A folder of images as a clip's frames --------------------------------------------------------

Frames = NDArray[np.uint8]

_NUMBER = re.compile(r"(.*?)([0-9]{1,18})")
_SECONDS = re.compile(r"[0-9]{1,12}[.]([0-9]{1,18})")
_SERIES = 0.8  # of a folder's images, numbered, beside which others are strangers
_TAIL = re.compile(r"(?<=[0-9])(?=[ (_-])")  # where the name of an image ends in that of its copy
_COUNTED = re.compile(r"[_-][0-9]+")  # an own number, as of several images of one second
_DEEP, _BRIGHT = (".png", ".tif", ".tiff"), 1 << 12  # 16 levels of 256 when they are read
SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})


class ImageFolder:
    """Images in the natural order of their names (``2.png`` before ``10.png``), one size.

    Names that are seconds, as ``0.067`` and ``0.1``, are in the order of these. Files of other
    kinds and hidden files are passed over. Images have no times: ``fps`` is None.
    ``names`` are those of all of them, without ending.
    """

    fps: None = None
    timestamps: None = None
    lost: int = 0

    def __init__(self, path: Path, stop: int | None = None) -> None:
        """List the first ``stop`` images, or all.

        Raises:
            InputError: no images, two of one number, or a first image that cannot be read.
        """
        files = [
            entry
            for entry in path.iterdir()
            if entry.suffix.lower() in SUFFIXES and not entry.name.startswith(".")
        ]
        if not files:
            raise InputError(f"{path}: holds no images{_held(path)}")
        self.path = path
        self.name = path.name
        files.sort(key=lambda file: natural_key(file.name))
        timed = _are_times([file.stem for file in files])
        if timed:
            files.sort(key=lambda file: float(file.stem))
        self.names = tuple(file.stem for file in files)
        self.files = files[:stop]
        self.total: int | None = len(files)
        _require_one_each(path, self.files)
        copies = _copies(self.files)
        originals = [file for file in self.files if file not in copies]
        self.warnings: tuple[str, ...] = (
            *_about_copies(path, copies),
            *(() if timed else _odd_numbers(path, originals)),
            *_few_bits(path, self.files),
        )
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


def _are_times(stems: Sequence[str]) -> bool:
    """Whether names are seconds without zeros at the end, rather than shots and frames: 1.09."""
    found = [_SECONDS.fullmatch(stem) for stem in stems]
    digits = [match[1] for match in found if match is not None]
    several = len(digits) == len(stems) and len(set(map(len, digits))) > 1
    longer = [each for each in digits if len(each) > 1]
    cut = not any(each.endswith("0") for each in longer)
    return several and cut and any(each.startswith("0") for each in longer)


def _require_one_each(path: Path, files: Sequence[Path]) -> None:
    """Refuse two images of one number, of two kinds or with other zeros before it."""
    places: dict[tuple[str, int], Path] = {}
    twice: list[tuple[Path, Path]] = []
    for file in files:
        match = _NUMBER.fullmatch(file.stem)
        if match is None or match[1].endswith((".", ",")):  # 0.05 is not 0.5
            place = file.stem.lower(), -1
        else:
            place = match[1].lower(), int(match[2])
        known = places.setdefault(place, file)
        if known is not file:
            twice.append((known, file))
    if twice:
        one, other = sorted(file.name for file in twice[0])
        raise InputError(
            f"{path}: holds images of one frame twice, {one} and {other} ({len(twice)} such of "
            f"{len(files)} images); expected one image of each frame, give each kind a folder of "
            "its own"
        )


def _copies(files: Sequence[Path]) -> dict[Path, str]:
    """Images named as another one with more behind, ``0003 (1)``, and what that one is called."""
    names = {file.stem.lower(): file.name for file in files}
    found = {}
    for file in files:
        for tail in _TAIL.finditer(file.stem):
            at = tail.start()
            original = names.get(file.stem[:at].lower())
            if original is not None and not _COUNTED.fullmatch(file.stem, at):
                found[file] = original
    return found


def _about_copies(path: Path, copies: Mapping[Path, str]) -> Iterator[str]:
    for first, original in islice(copies.items(), 1):
        many = f"{len(copies)} images" if len(copies) > 1 else "an image"
        yield (
            f"{path}: holds {many} named as another with more behind, {first.name!r} beside "
            f"{original!r}; all are taken for frames, so that what follows comes too late: leave "
            "one image of each frame"
        )


def _odd_numbers(path: Path, files: Sequence[Path]) -> Iterator[str]:
    """What the numbers at the ends of names tell: series run together, images that are missing."""
    found = [_NUMBER.fullmatch(file.stem) for file in files]
    known = [match for match in found if match is not None]
    strays = [file.name for file, match in zip(files, found, strict=True) if match is None]
    if len(known) >= _SERIES * len(files) and strays:
        names = ", ".join(repr(name)[:40] for name in strays[:4])
        yield (
            f"{path}: holds {names} without a number beside {len(known)} numbered images; taken "
            "for frames of the video, so that all behind come too late: move them elsewhere"
        )
    elif strays:
        return  # names of no series
    series = list(dict.fromkeys(match[1] for match in known))
    if len(series) > 1:
        names = ", ".join(repr(name)[:40] for name in series[:4])
        yield (
            f"{path}: holds {len(series)} series of images, whose names begin with {names}; they "
            "are taken for one video, one after the other: give each a folder of its own"
        )
        return
    numbers = [int(match[2]) for match in known]
    steps = [b - a for a, b in pairwise(numbers)]
    usual = median(steps) if steps else 1
    gaps = [(a, b) for a, b in pairwise(numbers) if b - a > usual]
    if gaps:
        where = ", ".join(f"{a} and {b}" for a, b in gaps[:3]) + (", ..." if len(gaps) > 3 else "")
        yield (
            f"{path}: images are missing between {where}; the others are taken one after the "
            "other, so that all behind a gap comes too early: fill it, or cut the clip there"
        )


def _few_bits(path: Path, files: Sequence[Path]) -> Iterator[str]:
    """That images of 16 bits hold numbers of 12 or fewer, as cameras of machines give them."""
    top = 0
    for file in (files[0], files[len(files) // 2], files[-1]):
        if file.suffix.lower() not in _DEEP:
            return
        image = decode_image(file, cv2.IMREAD_UNCHANGED)
        if image.dtype.itemsize != 2:
            return
        top = max(top, int(image.max()))
        if top >= _BRIGHT:
            return
    yield (
        f"{path}: images have 16 bits and no value above {top}, so that they are nearly black as "
        "they are read; multiply their values, by 16 where the camera gives 12 bits"
    )


def read_image(path: Path) -> Frames:
    """An image as 8-bit RGB (H, W, 3), turned as its EXIF orientation says.

    Raises:
        InputError: a file that is empty, too large or no image.
    """
    image = decode_image(path, cv2.IMREAD_COLOR)
    return np.ascontiguousarray(image[..., ::-1])


def read_silhouette(path: Path, person: int | None = None) -> NDArray[np.bool_]:
    """Where an image shows somebody, (H, W).

    Args:
        path: an image; of several channels their mean counts.
        person: value of the person in a map of labels; without it, what is brighter than half.

    Raises:
        InputError: it is missing, too large, or no image.
    """
    image = decode_image(path, cv2.IMREAD_GRAYSCALE, "an image of a silhouette")
    found: NDArray[np.bool_] = image > _HALF if person is None else image == person
    return found


_LEVELS, _LOOKED = 5, 1000  # of folders, as OpenCap's Videos/Cam0/InputMedia; entries of a level


def _held(folder: Path) -> str:
    """What to give in place of a folder without images, by what it holds."""
    found = _videos_in(folder)
    if not found:
        return "; expected a video, or a folder of PNG or JPEG frames"
    some = ", ".join(str(each) for each in found[:2])
    more = ", ..." if len(found) > 2 else ""
    return f", but videos; give these by name, one for each view: {some}{more}"


def _videos_in(folder: Path) -> list[Path]:
    """Videos of the first level of folders that has any."""
    level = [folder]
    for _ in range(_LEVELS):
        inside = list(islice(_entries(level), _LOOKED))
        found = [each for each in inside if each.suffix.lower() in VIDEO_SUFFIXES]
        if found:
            return sorted(found)
        level = [each for each in inside if each.is_dir()]
    return []


def _entries(folders: Sequence[Path]) -> Iterator[Path]:
    for folder in folders:
        with suppress(OSError):  # those that may not be looked into
            yield from (each for each in folder.iterdir() if not each.name.startswith("."))
