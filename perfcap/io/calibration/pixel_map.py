"""Videos whose pixels are not the pixels their cameras were calibrated in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration.rig import CameraRig
from perfcap.io.calibration.view import to_numbers
from perfcap.io.files import TEXT_LIMIT, read_json
from perfcap.io.view_names import find_view

_FITS = 0.01  # of the image's sides, by which the edges of a good map may be off
_TURNED = 0.5  # of the scale, across it: a lens may be a little askew, no more
KEY = "video_px_to_native_px"


@dataclass(frozen=True)
class PixelMap:
    """Affine maps (C, 3, 3) from a video's pixels to the pixels of its calibration."""

    matrices: Tensor

    def to_calibration(self, pixels: Tensor) -> Tensor:
        """Calibration pixels (*b, C, N, 2) of video pixels (*b, C, N, 2)."""
        return _apply(self.matrices, pixels)

    def to_video(self, pixels: Tensor) -> Tensor:
        """Video pixels (*b, C, N, 2) of calibration pixels (*b, C, N, 2), to draw them."""
        return _apply(torch.linalg.inv(self.matrices), pixels)

    def cameras(self, cameras: Camera, sizes: Sequence[tuple[int, int]]) -> Camera:
        """The same cameras, projecting into the pixels of their videos.

        Args:
            cameras: C views, fixed or moving, in pixels of the calibration.
            sizes: (height, width) of each view's video, C.
        """
        to_video = torch.linalg.inv(self.matrices).to(cameras.intrinsics)
        size = tuple((height, width) for height, width in sizes)
        return replace(cameras, intrinsics=to_video @ cameras.intrinsics, size=size)

    @property
    def identity(self) -> bool:
        """Whether videos and calibration share their pixels."""
        return bool((self.matrices == torch.eye(3).to(self.matrices)).all())


def _apply(matrices: Tensor, pixels: Tensor) -> Tensor:
    matrices = matrices.to(pixels)
    return pixels @ matrices[..., :2, :2].mT + matrices[..., None, :2, 2]


def read_pixel_map(
    path: str | Path, views: Sequence[str] = (), known: Sequence[str] = ()
) -> dict[str, Tensor]:
    """Read ``{"video_px_to_native_px": {view: 2x3 or 3x3}}`` as (3, 3) float64 by view name.

    Args:
        path: the file.
        views: of which it must name one at least, where any are known.
        known: further views of the calibration, which it may name as well. Names of none are
            refused where it lacks a view's.

    Raises:
        InputError: it cannot be used.
    """
    path = Path(path)
    data = read_json(path, "a map from video to calibration pixels", TEXT_LIMIT)
    entries = data.get(KEY) if isinstance(data, dict) else None
    if not isinstance(entries, dict) or not entries:
        raise InputError(f"{path}: has no '{KEY}' object; expected a 2x3 matrix by view name")
    maps = {str(name): _matrix(f"{path}: view {name}", entry) for name, entry in entries.items()}
    if views and all(_find(name, maps) is None for name in views):
        raise InputError(
            f"{path}: names {', '.join(maps)}, none of the views {', '.join(views)}; call each map "
            "as its view"
        )
    found = {find_view(view, list(maps)) for view in (*views, *known)}
    left = [name for index, name in enumerate(maps) if index not in found]
    lacking = [view for view in views if _find(view, maps) is None]
    if left and lacking:
        raise InputError(
            f"{path}: has maps of {', '.join(left)}, which are no views, and none of the views "
            f"{', '.join(lacking)}; call each map as its view, or leave it out"
        )
    return maps


def _matrix(where: str, entry: Any) -> Tensor:
    numbers = to_numbers(where, "map", entry)
    if numbers.shape == (2, 3):
        numbers = np.concatenate((numbers, [[0, 0, 1]]))
    if numbers.shape != (3, 3) or not np.allclose(numbers[2:], [[0, 0, 1]]):
        raise InputError(f"{where}: map has shape {numbers.shape}, expected an affine 2x3 matrix")
    if not np.isfinite(numbers).all() or abs(np.linalg.det(numbers[:2, :2])) < 1e-6:
        raise InputError(f"{where}: map cannot be inverted; expected scale and shift in pixels")
    along, across = np.diag(numbers)[:2], np.abs(np.fliplr(numbers[:2, :2]).diagonal())
    if not across.max() < _TURNED * along.min():
        raise InputError(
            f"{where}: map {numbers[:2, :2].tolist()} turns or mirrors the image; expected scale "
            "and shift, x to the right and y down in both: turn the video itself"
        )
    return torch.from_numpy(numbers)


def match_image(
    rig: CameraRig,
    video_sizes: Sequence[tuple[int, int]],
    maps: dict[str, Tensor] | None = None,
) -> PixelMap:
    """The map from each video's pixels to its calibration's; never a silent rescaling.

    Args:
        rig: C views.
        video_sizes: (height, width) of each view's video, C.
        maps: from ``read_pixel_map``, by view name as ``find_view`` understands it.

    Raises:
        InputError: sizes that differ without a map, or a map that misses the image.
    """
    if len(video_sizes) != len(rig.names):
        raise InputError(
            f"{len(video_sizes)} videos for {len(rig.names)} cameras, expected as many"
        )
    rows = zip(rig.names, rig.cameras.size, video_sizes, strict=True)
    return PixelMap(torch.stack([_match_view(*row, maps) for row in rows]))


def _match_view(
    name: str, size: tuple[int, int], video: tuple[int, int], maps: dict[str, Tensor] | None
) -> Tensor:
    matrix = _find(name, maps) if maps else None
    if matrix is not None:
        _check_overlap(name, matrix, size, video)
        return matrix
    if tuple(video) != tuple(size) and maps:
        raise InputError(
            f"view {name}: has no map among {', '.join(maps)} of --video-map, and its video is "
            f"{video[1]}x{video[0]}, its calibration for {size[1]}x{size[0]}; call the map {name}"
        )
    if tuple(video) != tuple(size):
        raise InputError(
            f"view {name}: the video is {video[1]}x{video[0]}, its calibration is for "
            f"{size[1]}x{size[0]}; calibrate at the video's size, or give the map between the two "
            "with --video-map FILE"
        )
    return torch.eye(3, dtype=torch.float64)


def _find(name: str, maps: dict[str, Tensor]) -> Tensor | None:
    keys = list(maps)
    found = find_view(name, keys)
    return None if found is None else maps[keys[found]]


def _check_overlap(
    name: str, matrix: Tensor, size: tuple[int, int], video: tuple[int, int]
) -> None:
    """A map that is inverted or in other units sends the video's middle out of the image."""
    middle = torch.tensor([[video[1] / 2, video[0] / 2]], dtype=torch.float64)
    x, y = _apply(matrix[None], middle[None])[0, 0].tolist()
    if not (0 <= x < size[1] and 0 <= y < size[0]):
        raise InputError(
            f"view {name}: the video map sends the middle of the {video[1]}x{video[0]} video to "
            f"({x:.0f}, {y:.0f}), outside its {size[1]}x{size[0]} calibration; expected "
            "x_calibration = M [x_video, y_video, 1]"
        )
    found, inverse = (_misfit(m, size, video) for m in (matrix, torch.linalg.inv(matrix)))
    if found > _FITS and inverse < found / 2:
        raise InputError(
            f"view {name}: the video map misses the edges of the {size[1]}x{size[0]} calibration "
            f"by {found:.1%}, its inverse by {inverse:.1%}; expected x_calibration = M [x_video, "
            "y_video, 1], invert it"
        )


def _misfit(matrix: Tensor, size: tuple[int, int], video: tuple[int, int]) -> float:
    """How far a mapped video's edges are from the calibration's, as a share of its sides."""
    height, width = video
    corners = [[0, 0], [width, 0], [0, height], [width, height]]
    mapped = _apply(matrix[None], torch.tensor([corners], dtype=torch.float64))[0]
    edges = torch.tensor([size[1], size[0]], dtype=torch.float64)
    off = torch.stack((mapped.amin(0), mapped.amax(0) - edges)).abs()
    return float((off / edges).max())
