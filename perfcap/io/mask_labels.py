"""Silhouettes drawn by hand: outlines of frames as JSON, made by ``tools/label_masks.py``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.draw import polygon2mask

from perfcap.errors import InputError
from perfcap.io.files import TEXT_LIMIT, read_json

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
