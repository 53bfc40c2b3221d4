"""Masks of a result in the pixels of true silhouettes, where video and calibration differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.io.calibration import CameraRig, read_cameras, read_pixel_map
from perfcap.io.files import known_file, read_json
from perfcap.io.result_folder import ASSUMED_CAMERA, REPORT, own_file
from perfcap.io.view_names import find_view

Mask = NDArray[np.bool_]

_SAME = 0.05  # px that matrices of one calibration may differ by, written in few digits
_ROUNDED = 1.0  # px that a side may be off after a plain scale


@dataclass(frozen=True)
class MaskPixels:
    """How masks of a result come into the pixels of the true silhouettes.

    Attributes:
        video: (height, width) of the masks, px.
        true: (height, width) of the true silhouettes, px.
        matrix: from pixels of the masks to those of the silhouettes, affine (2, 3), pixel centres
            at integers; None where both have the same.
    """

    video: tuple[int, int]
    true: tuple[int, int]
    matrix: NDArray[np.float64] | None = None

    def of_result(self, mask: Mask) -> Mask:
        """A mask (h, w) of the result in pixels of the truth, (H, W).

        Raises:
            InputError: it has another size than the other masks.
        """
        if self.matrix is None:
            return mask
        if mask.shape != self.video:
            raise InputError(
                f"masks of the result have sizes {self.video} and {mask.shape}; expected one"
            )
        return self._moved(mask) & self._seen()

    def of_truth(self, mask: Mask) -> Mask:
        """The part of a true silhouette (H, W) that the video shows: a crop hides the rest."""
        return mask if self.matrix is None or mask.shape != self.true else mask & self._seen()

    def _seen(self) -> Mask:
        whole = np.ones(self.video, dtype=np.bool_)
        return self._moved(whole, cv2.BORDER_CONSTANT, cv2.INTER_NEAREST)

    def _moved(
        self, mask: Mask, border: int = cv2.BORDER_REPLICATE, way: int = cv2.INTER_LINEAR
    ) -> Mask:
        assert self.matrix is not None
        moved = cv2.warpAffine(
            mask.astype(np.float32), self.matrix, self.true[::-1], flags=way, borderMode=border
        )
        shown: Mask = moved > 0.5
        return shown


def mask_pixels(
    folder: Path, video: tuple[int, int], true: tuple[int, int], rig: CameraRig | None
) -> MaskPixels:
    """How masks of a capture come into the pixels of true silhouettes.

    By the map between video and calibration that the capture was given, where the true silhouettes
    are in pixels of the calibration; as they are where these have the size of the video; scaled
    where there is no map and the shape of the image is the same.

    Args:
        folder: of the capture; its report names the map and the calibration.
        video: (height, width) of the masks, px.
        true: (height, width) of the true silhouettes, px.
        rig: cameras of the truth, where it has them.

    Raises:
        InputError: they have no pixels in common that are known, and why.
    """
    path = own_file(folder, REPORT)
    report = _mapping(None if path is None else read_json(path, "the report of a capture"))
    request = _mapping(report.get("request"))
    text = request.get("video_map")
    if not isinstance(text, str):
        matrix = None if video == true else _scale(video, true)
        if video != true and matrix is None:
            raise InputError(
                f"masks of the result are {_size(video)} and true silhouettes {_size(true)}, of "
                "another shape; expected those of the video"
            )
        return MaskPixels(video, true, matrix)
    views = report.get("views")
    view = str(views[0]) if isinstance(views, list) and views else ""
    try:
        matrix = _map(folder, text, view, _mapping(report.get("input_files")))
        size, own = _calibration(folder, request, view, video)
    except InputError:
        if video == true:
            return MaskPixels(video, true)
        raise
    if rig is not None and np.allclose(own, _intrinsics(rig.cameras, 0), rtol=1e-5, atol=_SAME):
        return MaskPixels(video, true, matrix)  # of one size, too, where the video is moved
    if video == true:
        return MaskPixels(video, true)
    if size != true:
        raise InputError(
            f"true silhouettes are {_size(true)}, the video of the capture {_size(video)} and its "
            f"calibration {_size(size)}; expected one of these two"
        )
    return MaskPixels(video, true, matrix)


def _scale(video: tuple[int, int], true: tuple[int, int]) -> NDArray[np.float64] | None:
    """The scale between images of one shape; None of others."""
    high, wide = (b / a for a, b in zip(video, true, strict=True))
    if abs(high - wide) * max(video) > _ROUNDED * max(1.0, high):
        return None
    # edges meet: the first lies half a pixel before the middle of the first pixel
    return np.array([[wide, 0, (wide - 1) / 2], [0, high, (high - 1) / 2]])


def _map(folder: Path, text: str, view: str, states: Mapping[str, Any]) -> NDArray[np.float64]:
    """The map from pixels of the video to those of the calibration, as the capture read it."""
    path = known_file(folder, text)
    maps = read_pixel_map(path, [view] if view else [])
    state = states.get(text)
    then = state.split(" bytes of ")[0] if isinstance(state, str) else ""
    now = str(path.stat().st_size)
    if then.isdecimal() and then != now:
        raise InputError(f"{path}: has {now} bytes, that of the capture had {then}")
    names = list(maps)
    found = find_view(view, names) if view else 0
    assert found is not None  # ``read_pixel_map`` refuses others
    matrix: NDArray[np.float64] = maps[names[found]].numpy()[:2]
    return matrix


def _calibration(
    folder: Path, request: Mapping[str, Any], view: str, video: tuple[int, int]
) -> tuple[tuple[int, int], NDArray[np.float64]]:
    """Size of the calibrated image, and intrinsics (3, 3) px, of the view of the masks."""
    text = request.get("cameras")
    path = known_file(folder, text) if isinstance(text, str) else own_file(folder, ASSUMED_CAMERA)
    if path is None:
        raise InputError(f"{folder / REPORT}: does not say which cameras the capture had")
    rig = read_cameras(path, [video])
    row = find_view(view, rig.names) if len(rig.names) > 1 else 0
    if row is None:
        raise InputError(f"{path}: has the views {', '.join(rig.names)}, the capture {view}")
    return rig.cameras.size[row], _intrinsics(rig.cameras, row)


def _intrinsics(cameras: Camera, view: int) -> NDArray[np.float64]:
    matrices = cameras.intrinsics.reshape(-1, *cameras.intrinsics.shape[-3:])
    found: NDArray[np.float64] = matrices[0, view].double().numpy()
    return found


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _size(size: tuple[int, int]) -> str:
    return f"{size[1]}x{size[0]}"
