"""Outlines of masks and of the surface as polygons, a few hundred bytes a frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.image_file import decode_image
from perfcap.io.mask_files import view_folders
from perfcap.io.result import Result
from perfcap.io.result_folder import MASKS, own_file
from perfcap.render import rasterize
from perfcap.workers import ordered_map

SUBPIXEL = 8  # points are multiples of an eighth of a pixel
_TOLERANCE = 0.5  # px by which a polygon may miss the border of its mask
_SMALLEST = 6  # px around an island
_BLOCK = 8  # frames

Mask = NDArray[np.bool_]
Ring = NDArray[np.int16]


@dataclass(frozen=True, eq=False)
class Outlines:
    """Closed polygons of every frame; inside is what an odd number of them surrounds.

    Attributes:
        rings: polygons a frame, (F,) uint16.
        lengths: points a polygon, (R,) uint16.
        points: from one point to the next, the first from the corner of the image,
            (N, 2) int16, in eighths of a pixel.
    """

    rings: NDArray[np.uint16]
    lengths: NDArray[np.uint16]
    points: NDArray[np.int16]

    @classmethod
    def collect(cls, frames: Iterable[Sequence[Ring]]) -> Outlines:
        """From the polygons (n, 2) of each frame."""
        listed = [list(frame) for frame in frames]
        rings = [ring for frame in listed for ring in frame]
        points = np.concatenate(rings) if rings else np.zeros((0, 2), np.int16)
        return cls(
            np.array([len(frame) for frame in listed], np.uint16),
            np.array([len(ring) for ring in rings], np.uint16),
            np.diff(points, axis=0, prepend=np.zeros((1, 2), np.int16)),
        )

    def frames(self) -> Iterator[list[Ring]]:
        """The polygons of each frame again."""
        places = np.cumsum(self.points, axis=0, dtype=np.int16)
        split = iter(np.split(places, np.cumsum(self.lengths, dtype=np.int64)[:-1]))
        for count in self.rings:
            yield [next(split) for _ in range(count)]


def trace(mask: Mask, scale: float = 1.0) -> list[Ring]:
    """Borders of a mask as polygons, in eighths of a pixel of an image ``scale`` times as large.

    Coordinates count from the corner of the image, as drawings in a browser do.
    """
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = []
    for border in found:
        if len(border) >= _SMALLEST:
            corners = cv2.approxPolyDP(border, _TOLERANCE / scale, True)[:, 0]
            rings.append(np.rint((corners + 0.5) * scale * SUBPIXEL).astype(np.int16))
    return [ring for ring in rings if len(ring) > 2]


def mask_outlines(
    folder: Path, names: Sequence[str], view: int, numbers: Sequence[int], size: tuple[int, int]
) -> Outlines | None:
    """Outlines of a view's masks; None where no frame has one.

    Args:
        folder: of a result.
        names: of the views.
        view: which.
        numbers: of the frames.
        size: shown height and width.
    """
    place = Path(MASKS, view_folders(list(names))[view])

    def traced(number: int) -> list[Ring] | None:
        mask = _read_mask(own_file(folder, (place / f"{number:06d}.png").as_posix()))
        if mask is None or abs(mask.shape[0] * size[1] - mask.shape[1] * size[0]) > sum(size):
            return None
        return trace(mask, size[0] / mask.shape[0])

    frames = [traced(number) for number in numbers]
    if all(frame is None for frame in frames):
        return None
    return Outlines.collect(frame or [] for frame in frames)


def surface_outlines(
    result: Result, rows: slice, cameras: Camera, sizes: Sequence[tuple[int, int]]
) -> list[Outlines]:
    """Outlines of the surface in every view.

    Args:
        result: the capture.
        rows: its frames.
        cameras: C views, fixed or (F, C) for these frames, of the shown images.
        sizes: shown height and width of each view.
    """
    faces = torch.as_tensor(result.template.faces.copy())
    found: list[list[list[Ring]]] = [[] for _ in sizes]
    for start in range(rows.start, rows.stop, _BLOCK):
        span = slice(start, min(start + _BLOCK, rows.stop))
        seen = cameras.frames(slice(span.start - rows.start, span.stop - rows.start))
        pixels, depth = _projected(seen, torch.from_numpy(result.vertices(span)))

        tasks = [
            (pixels[frame, view], depth[frame, view], faces, size)
            for frame in range(span.stop - span.start)
            for view, size in enumerate(sizes)
        ]
        for number, rings in enumerate(ordered_map(_drawn, tasks)):
            found[number % len(sizes)].append(rings)
    return [Outlines.collect(frames) for frames in found]


def shown_cameras(cameras: Camera, sizes: Sequence[tuple[int, int]]) -> Camera:
    """The cameras of images that are shown at other sizes; corners stay corners."""
    scale = torch.eye(3, dtype=cameras.intrinsics.dtype).repeat(len(sizes), 1, 1)
    for view, (small, full) in enumerate(zip(sizes, cameras.size, strict=True)):
        for axis, factor in enumerate((small[1] / full[1], small[0] / full[0])):
            scale[view, axis, axis] = factor
            scale[view, axis, 2] = 0.5 * factor - 0.5
    return replace(cameras, intrinsics=scale @ cameras.intrinsics, size=tuple(sizes))


def _drawn(task: tuple[Tensor, Tensor, Tensor, tuple[int, int]]) -> list[Ring]:
    return trace(rasterize(*task).mask.numpy())


def _projected(cameras: Camera, vertices: Tensor) -> tuple[Tensor, Tensor]:
    local = cameras.to_camera(vertices.to(cameras.intrinsics))
    return cameras.project_camera(local), local[..., 2]


def _read_mask(path: Path | None) -> Mask | None:
    if path is None:
        return None
    try:
        return decode_image(path, cv2.IMREAD_GRAYSCALE) > 0
    except InputError:  # damaged, or larger than is decoded
        return None
