"""COLMAP's text model: ``cameras.txt`` and ``images.txt`` in a folder."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from perfcap.errors import InputError
from perfcap.io.calibration.rig import CameraRig, make_rig
from perfcap.io.calibration.view import Array, View, make_view
from perfcap.io.files import JSON_LIMIT, natural_key, read_text

CAMERAS, IMAGES = "cameras.txt", "images.txt"
PIXEL_CENTRE = 0.5  # COLMAP's origin is the corner of the image

# parameters of a model -> fx, fy, cx, cy and up to k1, k2, p1, p2
_MODELS: dict[str, tuple[int, Callable[[Array], Sequence[float]]]] = {
    "SIMPLE_PINHOLE": (3, lambda p: (p[0], *p)),
    "PINHOLE": (4, lambda p: tuple(p)),
    "SIMPLE_RADIAL": (4, lambda p: (p[0], *p)),
    "RADIAL": (5, lambda p: (p[0], *p)),
    "OPENCV": (8, lambda p: tuple(p)),
}


@dataclass(frozen=True)
class _Lens:
    intrinsics: Array
    distortion: Array
    size: tuple[float, float]


@dataclass(frozen=True)
class _Image:
    name: str
    lens: int
    rotation: Array
    translation: Array


def read_colmap(path: Path, default_sizes: Sequence[tuple[int, int]] | None = None) -> CameraRig:
    """Read a folder (or either file in it) with OpenCV-like camera models.

    Images in folders are the frames of one view a folder. Images beside each other are one view
    each, unless all of them share one camera: then they are the frames of a moving camera.
    COLMAP's reconstructions have no scale: the translations must have been made metric.
    """
    folder = path if path.is_dir() else path.parent
    lenses = _read_lenses(folder / CAMERAS)
    images = _read_images(folder / IMAGES)
    groups = _by_view(images)
    views = [_view(folder, name, group, lenses) for name, group in groups.items()]
    note = f"{folder}: COLMAP models have no scale of their own; translations are read as metres"
    rig = make_rig(str(folder), views, default_sizes=default_sizes, warnings=[note])
    left_out = next(filter(None, map(_left_out, groups.values())), "")
    return replace(rig, left_out=left_out)


def _left_out(images: Sequence[_Image]) -> str:
    """The image before which COLMAP placed none or jumps, by the numbers in their names."""
    found = [re.search(r"(\d+)\D*$", PurePosixPath(image.name).stem) for image in images]
    numbers = [int(match[1]) for match in found if match is not None]
    if len(images) < 2 or len(numbers) < len(images):
        return ""
    start = min(numbers[0], 1)  # the first is called 0 or 1
    late = (k for k, number in enumerate(numbers) if number != start + k)
    return next((images[k].name for k in late), "")


def _by_view(images: Sequence[_Image]) -> dict[str, list[_Image]]:
    ordered = sorted(images, key=lambda image: natural_key(image.name))
    paths = [PurePosixPath(image.name) for image in ordered]
    if all(len(path.parts) > 1 for path in paths):
        names = [path.parent.as_posix() for path in paths]
    elif len({image.lens for image in images}) == 1 and len(images) > 1:
        names = ["camera"] * len(images)
    else:
        names = [path.stem for path in paths]
    groups: dict[str, list[_Image]] = {}
    for name, image in zip(names, ordered, strict=True):
        groups.setdefault(name, []).append(image)
    return groups


def _view(folder: Path, name: str, images: Sequence[_Image], lenses: dict[int, _Lens]) -> View:
    where = f"{folder / IMAGES}: view {name}"
    used = {image.lens for image in images}
    if len(used) > 1:
        raise InputError(f"{where}: uses {len(used)} cameras, expected one; share intrinsics")
    lens = lenses.get(min(used))
    if lens is None:
        raise InputError(f"{where}: camera {min(used)} is not in {folder / CAMERAS}")
    return make_view(
        where,
        name,
        intrinsics=lens.intrinsics,
        rotation=np.stack([image.rotation for image in images]),
        translation=np.stack([image.translation for image in images]),
        distortion=lens.distortion,
        size=lens.size,
        pixel_centre=PIXEL_CENTRE,
    )


def _read_lenses(path: Path) -> dict[int, _Lens]:
    lenses = {}
    for number, line in _lines(path):
        fields = line.split()
        if not fields:
            continue
        where = f"{path}: line {number}"
        if len(fields) < 5 or fields[1] not in _MODELS:
            model = fields[1] if len(fields) > 1 else line
            raise InputError(
                f"{where}: camera model {model}, expected one of {', '.join(_MODELS)}; "
                "undistort the images with COLMAP first"
            )
        count, spread = _MODELS[fields[1]]
        numbers = _numbers(where, fields[2:], 2 + count)
        fx, fy, cx, cy, *lens = spread(numbers[2:])
        intrinsics = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        size = (float(numbers[1]), float(numbers[0]))
        lenses[int(_numbers(where, fields[:1], 1)[0])] = _Lens(intrinsics, np.array(lens), size)
    return lenses


def _read_images(path: Path) -> list[_Image]:
    """Every other line is an image; the one after it holds its points and may be empty."""
    images = []
    lines = _lines(path)
    for number, line in lines[1::2]:
        last = line.split()[-1:]  # of x, y and the number of a point, or the name of an image
        if last and not last[0].lstrip("-").isdecimal():
            raise InputError(
                f"{path}: line {number}: ends in {last[0]:.40}, expected the points of the image "
                "before it; each image takes two lines, the second may be empty"
            )
    for number, line in lines[::2]:
        fields = line.split(maxsplit=9)
        where = f"{path}: line {number}"
        if len(fields) != 10:
            raise InputError(
                f"{where}: has {len(fields)} fields, expected id, qw qx qy qz, tx ty tz, camera "
                "id, name; each image takes two lines, the second may be empty"
            )
        numbers = _numbers(where, fields[1:9], 8)
        rotation = _quaternion_matrix(where, numbers[:4])
        images.append(_Image(fields[9], int(numbers[7]), rotation, numbers[4:7]))
    return images


def _lines(path: Path) -> list[tuple[int, str]]:
    what = f"COLMAP's {CAMERAS} and {IMAGES} beside each other"
    text = read_text(path, what, JSON_LIMIT).splitlines()  # images.txt lists every point
    lines = [(i, line) for i, line in enumerate(text, 1) if not line.startswith("#")]
    while lines and not lines[0][1].strip():
        del lines[0]
    while lines and len(lines) % 2 and not lines[-1][1].strip():
        del lines[-1]
    return lines


def _numbers(where: str, fields: Sequence[str], count: int) -> Array:
    try:
        numbers = np.array([float(field) for field in fields])
    except ValueError as error:
        raise InputError(f"{where}: {error}; expected numbers") from error
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(f"{where}: expected {count} finite numbers, found {len(numbers)}")
    return numbers


def _quaternion_matrix(where: str, quaternion: Array) -> Array:
    """Rotation matrix of a Hamilton quaternion w, x, y, z of any length but zero."""
    length = float(np.linalg.norm(quaternion))
    if length < 1e-6:
        raise InputError(f"{where}: rotation quaternion is zero")
    w, *vector = quaternion / length
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: Array = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return matrix
