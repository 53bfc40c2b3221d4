"""Detections as ``detections.npz``, which ``read_detections`` reads again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.atomic import writing


def save_detections(
    path: Path,
    detections: Detections,
    views: Sequence[str] = (),
    *,
    start: int = 0,
    pixel_offset: float = 0.0,
    video_frames: int | None = None,
) -> None:
    """Write the 16 landmarks of C views.

    Args:
        path: the file, .npz.
        detections: (F, C, 16).
        views: names of the views, C.
        start: frames of the video before the first detection; written as unseen, so that frame
            numbers are those of the video.
        pixel_offset: what readers will add to pixels: ``CameraRig.pixel_offset``.
        video_frames: of the whole video, of which these may be a part; None where not known.

    Raises:
        InputError: the place cannot be written.
    """
    arrays = _seen(detections, pixel_offset)
    if detections.joints3d is not None:
        trusted = detections.trusted3d[..., None, None]
        pose = (1000 * detections.joints3d).where(trusted, float("nan"))
        arrays["joints3d_mm"] = pose
    if detections.views == 1:
        arrays, views = {name: array[:, 0] for name, array in arrays.items()}, ()
    _write(path, arrays, views, start, video_frames)


def save_candidates(
    path: Path,
    candidates: Detections,
    views: Sequence[str] = (),
    *,
    start: int = 0,
    pixel_offset: float = 0.0,
    video_frames: int | None = None,
) -> None:
    """Write people without names, (P, F, C, 16), as ``read_candidates`` reads them.

    Args:
        path: the file, .npz.
        candidates: 3D joints are left out.
        views: as of ``save_detections``, and so are the others.
        start: frames of the video before the first.
        pixel_offset: what readers will add to pixels.
        video_frames: of the whole video.

    Raises:
        InputError: the place cannot be written.
    """
    arrays = _seen(candidates, pixel_offset)
    arrays = {name: array.movedim(0, 2) for name, array in arrays.items()}
    _write(path, arrays, views, start, video_frames)


def _seen(detections: Detections, pixel_offset: float) -> dict[str, Tensor]:
    """Joints in pixels and their confidence; zero where there are none."""
    seen = detections.confidence2d[..., None] > 0
    joints2d = (detections.joints2d - pixel_offset).where(seen, 0)
    return {"joints2d": joints2d, "confidence2d": detections.confidence2d}


def _write(
    path: Path,
    arrays: Mapping[str, Tensor],
    views: Sequence[str],
    start: int,
    video_frames: int | None,
) -> None:
    """Arrays (F, ...) after frames of which nothing is known, and what readers must know."""
    stored: dict[str, NDArray[Any]] = {
        name: _padded(array, start, np.nan if name == "joints3d_mm" else 0.0)
        for name, array in arrays.items()
    }
    stored["joint_names"] = np.array(LANDMARKS)
    if views:
        stored["view_names"] = np.array(list(views))
    if video_frames is not None:
        stored["video_frames"] = np.array(video_frames)
    with writing(path) as file:
        np.savez_compressed(file, **stored)  # type: ignore[arg-type]


def _padded(values: Tensor, start: int, fill: float) -> NDArray[np.float32]:
    array = values.detach().cpu().numpy().astype(np.float32)
    before = np.full((start, *array.shape[1:]), fill, np.float32)
    return np.concatenate((before, array))
