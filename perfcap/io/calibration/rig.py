"""The cameras of a capture, by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration.view import Array, View
from perfcap.io.view_names import find_view, match_views
from perfcap.rates import frame_rate
from perfcap.setting_checks import require_number


@dataclass(frozen=True)
class CameraRig:
    """Calibrated views and what their file says beside the numbers.

    Attributes:
        names: one a view, C.
        cameras: (C,), or (F, C) when any of them moves; float64.
        fps: frames a second, when the file says so.
        pixel_offset: to add to pixel coordinates of detections that come with this file, so that
            pixel centres are at integers: 0, or -0.5 where the file counts from the image corner.
        warnings: what a user should know about how the file was read.
        guessed: whether the focal length is a guess, with nothing to go by.
        left_out: the first of a moving camera's images that is not numbered like its pose, where
            poses of images before it are missing.
    """

    names: tuple[str, ...]
    cameras: Camera
    fps: float | None = None
    pixel_offset: float = 0.0
    warnings: tuple[str, ...] = ()
    guessed: bool = False
    left_out: str = ""

    def __post_init__(self) -> None:
        if self.fps is not None:
            frame_rate(self.fps, "fps")
        require_number(self.pixel_offset, "pixel_offset")

    def select(self, views: Sequence[int]) -> Self:
        """Some views, in the order given."""
        return replace(
            self,
            names=tuple(self.names[i] for i in views),
            cameras=self.cameras.select(list(views)),
        )

    def match(self, videos: Sequence[str]) -> Self:
        """The views of some videos, by name where names tell, else in the order of the file.

        When names do not tell (see ``match_views``), there must be as many videos as views.

        Raises:
            InputError: names that do not tell, and a wrong number of them.
        """
        order = match_views(videos, self.names)
        if order is not None:
            return self.select(order)
        if len(videos) == len(self.names) and not self._some_known(videos):
            return self
        raise InputError(
            f"--cameras: holds the views {', '.join(self.names)}, which do not match the videos "
            f"{', '.join(videos)} one to one; name each video after its view"
        )

    def _some_known(self, videos: Sequence[str]) -> bool:
        """Whether some names tell although others do not: the order is then anybody's guess."""
        return len(videos) > 1 and any(find_view(name, self.names) is not None for name in videos)


def make_rig(
    where: str,
    views: Sequence[View],
    *,
    fps: float | None = None,
    pixel_offset: float = 0.0,
    default_sizes: Sequence[tuple[int, int]] | None = None,
    warnings: Sequence[str] = (),
) -> CameraRig:
    """Put views together; views that stand still follow the frames of those that move.

    Raises:
        InputError: no views, repeated names, unequal frame counts, or unknown image sizes.
    """
    if not views:
        raise InputError(f"{where}: holds no cameras; expected at least one view")
    names = [view.name for view in views]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{where}: names view {', '.join(twice)} more than once")
    lengths = sorted({len(view.rotation) for view in views} - {1})
    if len(lengths) > 1:
        raise InputError(
            f"{where}: moving cameras have {lengths[0]} and {lengths[-1]} frames, expected the "
            "same number"
        )
    sizes, notes = _sizes(where, views, default_sizes)
    return CameraRig(tuple(names), _camera(views, sizes), fps, pixel_offset, (*warnings, *notes))


def _camera(views: Sequence[View], sizes: tuple[tuple[int, int], ...]) -> Camera:
    intrinsics = _stack([view.intrinsics for view in views])
    lenses = np.stack([view.distortion for view in views])
    distortion = torch.from_numpy(lenses).expand(*intrinsics.shape[:-2], 5)
    return Camera(
        intrinsics,
        _stack([view.rotation for view in views]),
        _stack([view.translation for view in views]),
        distortion if lenses.any() else None,
        sizes,
    )


def _stack(arrays: Sequence[Array]) -> torch.Tensor:
    """(C, ...) from per-view (1, ...), or (F, C, ...) when any view has frames."""
    frames = max(len(array) for array in arrays)
    spread = [np.broadcast_to(array, (frames, *array.shape[1:])) for array in arrays]
    stacked = torch.from_numpy(np.stack(spread, 1))
    return stacked[0] if frames == 1 else stacked


def _sizes(
    where: str, views: Sequence[View], defaults: Sequence[tuple[int, int]] | None
) -> tuple[tuple[tuple[int, int], ...], list[str]]:
    if defaults is not None and len(set(defaults)) == 1:
        defaults = list(defaults[:1]) * len(views)  # fewer videos than cameras, all of one size
    unknown = [view.name for view in views if view.size is None]
    if unknown and (defaults is None or len(defaults) != len(views)):
        raise InputError(
            f"{where}: does not say the image size of {', '.join(unknown)}; calibrations hold for "
            "one size only: add width and height"
        )
    sizes = tuple(
        view.size if view.size is not None else (defaults or ())[i] for i, view in enumerate(views)
    )
    note = f"{where}: no image size for {', '.join(unknown)}; the size of the video was taken"
    return sizes, [note] if unknown else []
