"""One view as a camera file states it, checked: what every calibration reader produces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError

Array = NDArray[np.float64]

# Written with four digits or more, a rotation is this close to orthonormal.
ORTHONORMAL_TOLERANCE = 1e-3
MAX_SIDE = 65536  # px


@dataclass(frozen=True)
class View:
    """A calibrated view, with a leading frame axis of 1 when the camera stands still.

    Attributes:
        name: what the file calls it.
        intrinsics: (F, 3, 3), pixels, pixel centres at integers.
        rotation: world to camera, (F, 3, 3).
        translation: world to camera, (F, 3), metres.
        distortion: (5,), OpenCV's k1, k2, p1, p2, k3.
        size: image (height, width), or None when the file does not say.
    """

    name: str
    intrinsics: Array
    rotation: Array
    translation: Array
    distortion: Array
    size: tuple[int, int] | None


def make_view(
    where: str,
    name: str,
    *,
    intrinsics: Any,
    rotation: Any,
    translation: Any,
    distortion: Any = None,
    size: tuple[Any, Any] | None = None,
    pixel_centre: float = 0.0,
) -> View:
    """Check what a file says about a view.

    Args:
        where: the file and entry, for messages.
        name: the view's name.
        intrinsics: K, (3, 3) or (F, 3, 3).
        rotation: world to camera, (3, 3) or (F, 3, 3).
        translation: world to camera, (3,) or (F, 3).
        distortion: up to five numbers of OpenCV's model, or None.
        size: (height, width).
        pixel_centre: coordinate of the top-left pixel's centre in the file, 0 or 0.5.

    Raises:
        InputError: numbers that cannot be a camera.
    """
    k = _stack(where, "K", intrinsics, (3, 3))
    r = _stack(where, "rotation R", rotation, (3, 3))
    t = _stack(where, "translation t", translation, (3,))
    k, r, t = _same_frames(where, k, r, t)
    _check_intrinsics(where, k)
    k = k.copy()
    k[:, :2, 2] -= pixel_centre  # ours are at integers
    return View(name, k, _proper(where, r), t, _distortion(where, distortion), _size(where, size))


def _stack(where: str, what: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Numbers of one shape, or of that shape a frame, as (F, *shape)."""
    if value is None:
        raise InputError(f"{where}: has no {what}; every view needs K, R and t")
    array = to_numbers(where, what, value)
    if array.shape[-len(shape) :] != shape or array.ndim > len(shape) + 1 or array.size == 0:
        raise InputError(
            f"{where}: {what} has shape {array.shape}, expected {shape} or (frames, *{shape})"
        )
    if not np.isfinite(array).all():
        raise InputError(f"{where}: {what} holds NaN or infinity; calibrate this view again")
    return array.reshape(-1, *shape)


def to_numbers(where: str, what: str, value: Any) -> Array:
    """A regular array of numbers."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: {what} is not a regular array of numbers") from error


def _same_frames(where: str, *arrays: Array) -> tuple[Array, ...]:
    """Spread entries given once over the frames of the others; collapse a camera that rests."""
    frames = max(len(array) for array in arrays)
    if any(len(array) not in (1, frames) for array in arrays):
        counts = ", ".join(str(len(array)) for array in arrays)
        raise InputError(
            f"{where}: K, R and t have {counts} frames, expected one each or the same number"
        )
    if all((array == array[:1]).all() for array in arrays):
        return tuple(array[:1] for array in arrays)
    return tuple(np.broadcast_to(array, (frames, *array.shape[1:])) for array in arrays)


def _check_intrinsics(where: str, k: Array) -> None:
    focal = k[:, (0, 1), (0, 1)]
    if (focal <= 0).any():
        raise InputError(
            f"{where}: focal length {focal.min():g} px, expected positive numbers in K[0][0] and "
            "K[1][1]; an image that runs the other way is a rotation, not a negative focal length"
        )
    if not np.allclose(k[:, 2], (0, 0, 1)) or not np.allclose(k[:, 1, 0], 0):
        raise InputError(
            f"{where}: K is not [[fx, s, cx], [0, fy, cy], [0, 0, 1]]; is it transposed?"
        )


def _proper(where: str, rotation: Array) -> Array:
    """The nearest rotations to almost orthonormal matrices (polar decomposition)."""
    error = np.abs(rotation @ rotation.swapaxes(-1, -2) - np.eye(3)).max()
    if error > ORTHONORMAL_TOLERANCE:
        raise InputError(
            f"{where}: R is not orthonormal (R R' differs from I by {error:.2g}); expected a "
            "rotation without scale; write it with more digits or divide the scale out"
        )
    if (np.linalg.det(rotation) < 0).any():
        raise InputError(
            f"{where}: R mirrors space (determinant -1); expected a rotation; an axis was flipped "
            "when converting: flip two axes, not one"
        )
    left, _, right = np.linalg.svd(rotation)
    nearest: Array = left @ right
    return nearest


def _distortion(where: str, value: Any) -> Array:
    numbers = np.zeros(0) if value is None else to_numbers(where, "distortion", value).reshape(-1)
    if not np.isfinite(numbers).all():
        raise InputError(f"{where}: distortion holds NaN or infinity; calibrate this view again")
    if numbers[5:].any():
        raise InputError(
            f"{where}: distortion has {len(numbers)} coefficients, expected at most five "
            "(k1, k2, p1, p2, k3); calibrate without the rational and thin-prism models"
        )
    return np.concatenate((numbers[:5], np.zeros(max(0, 5 - len(numbers)))))


def _size(where: str, size: tuple[Any, Any] | None) -> tuple[int, int] | None:
    if size is None or size[0] is None or size[1] is None:
        return None
    numbers = to_numbers(where, "image size", size).reshape(-1)
    if len(numbers) != 2:
        raise InputError(
            f"{where}: image size has {len(numbers)} numbers, expected width and height"
        )
    height, width = numbers
    if not (1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE):
        raise InputError(f"{where}: image size {width:g}x{height:g}, expected pixels")
    return int(height), int(width)
