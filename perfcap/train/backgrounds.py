"""What is behind people: procedural pictures without end, or a folder of the user's own."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.io.image_file import decode_image

Picture = NDArray[np.uint8]
Floats = NDArray[np.float32]

_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".webp"}
_LEAVES = (20, 160)  # shapes in a picture
_MOST = 100_000  # files listed
_COARSER = 1.5  # pixels of a picture along one that is drawn: it is out of focus, or far away
_KEPT = 0.15  # of pictures that are procedural even where there is a folder


class Backgrounds:
    """Random pictures of any size.

    Args:
        folder: of photographs without people; None for procedural pictures alone.

    Raises:
        InputError: the folder is missing or holds no pictures.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.files: list[Path] = []  # of the folder, sorted
        if folder is not None:
            if not folder.is_dir():
                raise InputError(
                    f"{folder}: no such folder; expected pictures without people as backgrounds"
                )
            found = (p for p in folder.rglob("*") if p.suffix.lower() in _SUFFIXES)
            self.files = sorted(path for _, path in zip(range(_MOST), found, strict=False))
            if not self.files:
                raise InputError(
                    f"{folder}: has no pictures; expected files that end in "
                    f"{', '.join(sorted(_SUFFIXES))}"
                )

    @property
    def digest(self) -> str | None:
        """SHA-256 of the names and sizes of the pictures; None of procedural ones alone."""
        return digest_of(self.files) if self.files else None

    def draw(self, size: int, rng: np.random.Generator) -> Picture:
        """A picture (size, size, 3), RGB."""
        if self.files and rng.random() >= _KEPT:
            return self.photograph(size, rng)
        coarse = procedural(round(size / _COARSER), rng)
        full = cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC)
        if rng.random() < 0.6:  # of the camera, not of what it sees
            grain = rng.normal(0, rng.uniform(0, 12), (size, size, 1))
            full = (full + grain).clip(0, 255)
        return np.asarray(full, np.uint8)

    def photograph(self, size: int, rng: np.random.Generator) -> Picture:
        """A part of a picture of the folder, (size, size, 3); there must be one."""
        return _part(self.files[int(rng.integers(len(self.files)))], size, rng)


def digest_of(files: Iterable[Path]) -> str:
    """SHA-256 of the names and sizes of files: other ones are other data."""
    total = hashlib.sha256()
    for path in files:
        total.update(f"{path.name}\0{path.stat().st_size}\0".encode())
    return total.hexdigest()


def procedural(size: int, rng: np.random.Generator) -> Picture:
    """Walls, floors, clutter or noise, (size, size, 3)."""
    picture = surface(size, rng)
    kind = rng.random()
    if kind < 0.45:  # a floor below a wall
        horizon = int(size * rng.uniform(0.25, 0.85))
        floor = surface(size, rng)
        tilt = rng.normal(0, 0.03) * size
        corners = np.array([[0, horizon + tilt], [size, horizon - tilt], [size, size], [0, size]])
        mask = np.zeros((size, size), np.uint8)
        cv2.fillPoly(mask, [corners.round().astype(np.int32)], 255)
        picture[mask > 0] = floor[mask > 0]
    if rng.random() < 0.75:
        _scatter(picture, rng)
    if rng.random() < 0.35:
        sigma = rng.uniform(0.5, 3.0)
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.uint8)
    return picture


def surface(size: int, rng: np.random.Generator) -> Picture:
    """One uneven, perhaps patterned surface, (size, size, 3)."""
    share = _noise(size, rng)
    kind = rng.random()
    if kind < 0.15:
        share = _tiles(size, rng) * 0.7 + 0.3 * share
    elif kind < 0.3:  # a slope of light
        y, x = np.mgrid[:size, :size].astype(np.float32) / size
        turn = rng.uniform(0, 2 * np.pi)
        share = 0.375 * (1 + np.cos(turn) * (2 * x - 1) + np.sin(turn) * (2 * y - 1)) + 0.25 * share
    elif kind < 0.75:  # wood, fur, marble, leaves: noise that is bent by noise
        share = _bent(share, rng)
    # several colours along the way from dark to light
    tones = np.stack([natural_color(rng) for _ in range(int(rng.integers(2, 6)))])
    tones = tones.mean(0) + rng.uniform(0.2, 1.0) * (tones - tones.mean(0))
    place = share.clip(0, 1) * 255
    levels = np.linspace(0, 255, len(tones))
    table = np.stack([np.interp(np.arange(256), levels, tone) for tone in tones.T], -1)
    return np.asarray(table[place.astype(np.uint8)].clip(0, 255), np.uint8)


def _tiles(size: int, rng: np.random.Generator) -> Floats:
    """Boards, tiles or stripes, (size, size), 0 to 1."""
    y, x = np.mgrid[:size, :size].astype(np.float32)
    turn = rng.uniform(0, np.pi)
    period = size * np.exp(rng.uniform(np.log(0.02), np.log(0.4)))
    along = np.cos(turn) * x + np.sin(turn) * y
    share = (np.sin(2 * np.pi * along / period) > rng.uniform(-0.9, 0.9)).astype(np.float32)
    if rng.random() < 0.4:
        across = np.cos(turn) * y - np.sin(turn) * x
        share = np.abs(share - 0.8 * (np.sin(2 * np.pi * across / period) > 0))
    return np.asarray(share, np.float32)


def _bent(share: Floats, rng: np.random.Generator) -> Floats:
    """A surface pulled about by smooth noise, stretched, perhaps folded and mirrored."""
    size = len(share)
    y, x = np.mgrid[:size, :size].astype(np.float32)
    pull = size * rng.uniform(0.02, 0.35)
    x, y = (axis + pull * (2 * _noise(size, rng, 4) - 1) for axis in (x, y))
    stretch, turn = np.exp(rng.uniform(0, 1.8)), rng.uniform(0, np.pi)
    along = np.cos(turn) * x + np.sin(turn) * y
    across = (np.cos(turn) * y - np.sin(turn) * x) * stretch
    bent = cv2.remap(
        share,
        np.asarray(along, np.float32),
        np.asarray(across, np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REFLECT,
    )
    if rng.random() < 0.5:  # rings and stripes along its levels
        bent = 0.5 + 0.5 * np.sin(bent * rng.uniform(4, 40))
    if rng.random() < 0.3:
        half = bent[:, : (size + 1) // 2]
        bent = np.concatenate([half, half[:, ::-1]], 1)[:, :size]
    return np.asarray(bent, np.float32)


def natural_color(rng: np.random.Generator) -> NDArray[np.float64]:
    """An sRGB colour (3,), 0 to 255; most are dull, as most things are."""
    grey, color = rng.uniform(0, 255), rng.uniform(0, 255, 3)
    mixed: NDArray[np.float64] = grey + rng.beta(1.0, 1.6) * (color - grey)
    return mixed


def _noise(size: int, rng: np.random.Generator, octaves: int = 8) -> Floats:
    """Sums of smooth noise of several sizes, (size, size), 0 to 1; few or many octaves."""
    total = np.zeros((size, size), np.float32)
    fall = rng.uniform(0.4, 1.0)
    strength = 1.0
    for octave in range(1, int(rng.integers(3, octaves + 1))):
        cells = 2**octave
        shape = (max(2, int(cells * rng.uniform(0.5, 1.5))), cells)
        grid = rng.normal(size=shape).astype(np.float32)
        total += strength * cv2.resize(grid, (size, size), interpolation=cv2.INTER_CUBIC)
        strength *= fall
    low, high = np.percentile(total[::4, ::4], [2, 98])
    return np.asarray(((total - low) / max(high - low, 1e-6)).clip(0, 1), np.float32)


def _scatter(picture: Picture, rng: np.random.Generator) -> None:
    """Opaque shapes of all sizes over one another, as in the dead leaves model of images."""
    size = len(picture)
    count = int(np.exp(rng.uniform(*np.log(_LEAVES))))
    cloth = surface(size, rng)
    for _ in range(count):
        radius = size * min(0.4, 0.012 * rng.pareto(1.3) + 0.008)
        add_shape(picture, cloth, rng.uniform(0, size, 2), radius, rng)


def add_shape(
    picture: Picture,
    cloth: Picture,
    center: NDArray[np.float64],
    radius: float,
    rng: np.random.Generator,
) -> None:
    """Draw an ellipse, polygon or bar, plain or cut from another picture of the same size."""
    color = tuple(float(v) for v in natural_color(rng))
    mask = np.zeros(picture.shape[:2], np.uint8) if rng.random() < 0.25 else None
    target, paint = (picture, color) if mask is None else (mask, (255.0,))
    kind = rng.random()
    x, y = (int(v) for v in center)
    if kind < 0.35:
        axes = (max(1, int(radius)), max(1, int(radius * rng.uniform(0.2, 1))))
        turn = rng.uniform(0, 180)
        cv2.ellipse(target, (x, y), axes, turn, 0, 360, paint, -1, cv2.LINE_AA)
        if mask is None and radius > 4 and rng.random() < 0.6:  # round, or with rings
            for share in (0.75, 0.5, 0.25):
                inner = (max(1, int(share * axes[0])), max(1, int(share * axes[1])))
                mixed = natural_color(rng) if rng.random() < 0.5 else 1.15 * np.array(color)
                ring = tuple(float(v) for v in mixed.clip(0, 255))
                cv2.ellipse(target, (x, y), inner, turn, 0, 360, ring, -1, cv2.LINE_AA)
    elif kind < 0.75:
        angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 7))))
        points = center + radius * rng.uniform(0.5, 1.4, (len(angle), 1)) * np.stack(
            [np.cos(angle), np.sin(angle)], -1
        )
        cv2.fillPoly(target, [points.round().astype(np.int32)], paint, cv2.LINE_AA)
    else:  # long and thin, as limbs, poles and branches are
        along = rng.normal(size=2)
        along *= radius * rng.uniform(1.5, 6) / np.linalg.norm(along)
        start, end = (tuple(int(v) for v in center + s * along) for s in (-1, 1))
        cv2.line(target, start, end, paint, max(1, int(0.35 * radius)), cv2.LINE_AA)
    if mask is not None:
        cv2.copyTo(cloth, mask, picture)


def read_picture(path: Path) -> Picture:
    """A picture of the user's, RGB, (H, W, 3).

    Raises:
        InputError: it cannot be read.
    """
    try:
        return decode_image(path, cv2.IMREAD_COLOR_RGB, "a picture")
    except InputError as error:
        raise InputError(
            f"{path}: cannot be read as a picture; remove it from the backgrounds"
        ) from error


def _part(path: Path, size: int, rng: np.random.Generator) -> Picture:
    """A random square of a photograph."""
    image = read_picture(path)
    height, width = image.shape[:2]
    side = int(min(height, width) * rng.uniform(0.4, 1.0))
    y, x = int(rng.integers(height - side + 1)), int(rng.integers(width - side + 1))
    part = image[y : y + side, x : x + side]
    if rng.random() < 0.5:
        part = part[:, ::-1]
    return np.asarray(cv2.resize(part, (size, size), interpolation=cv2.INTER_AREA), np.uint8)
