"""Whether lenses, directions and sightings are some; else they are refused."""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_shape
from perfcap.errors import InputError
from perfcap.matchmove.corner_tracks import Sightings
from perfcap.rates import frame_rate, rate_doubts

Array = NDArray[np.float64]

_WIDEST = 0.1  # focal length by the longer side: no pinhole sees 157 degrees
_SHARES = 1.5  # px; a principal point that is nearer to the corner is a share of the image's size
_OFF = 0.01  # of a unit vector's length
_SKEWED = 0.05  # of a rotation's rows


def require_lens(lens: tuple[float, float, float], longest: float) -> None:
    """Refuse a lens, focal length and principal point x, y in px, that no such image has.

    Args:
        lens: as it was given.
        longest: px, of the image's longer side, or of as much of it as is known.

    Raises:
        InputError: it is in millimetres, or in shares of the image's size.
    """
    numbers = np.asarray(lens, np.float64)
    if numbers.shape != (3,) or not np.isfinite(numbers).all() or not numbers[0] > 0:
        raise InputError(
            f"lens is {lens!r:.80}, expected focal length, above zero, and principal point x, y, px"
        )
    if numbers[0] < _WIDEST * longest:
        raise InputError(
            f"lens has a focal length of {numbers[0]:.4g} px of images {longest:.0f} px long, "
            "expected pixels, not millimetres: times the width in pixels by that of the sensor"
        )
    if longest > 100 * _SHARES and (np.abs(numbers[1:]) < _SHARES).all():
        raise InputError(
            f"lens has its principal point at {numbers[1]:.4g}, {numbers[2]:.4g} of images "
            f"{longest:.0f} px long, expected pixels near the middle of the image"
        )


def require_sightings(
    sightings: Sightings, frames: int, lens: tuple[float, float, float], rate: float
) -> None:
    """Refuse sightings of other frames or of another lens, and what is no rate.

    Raises:
        InputError: they are.
    """
    rate = frame_rate(rate)
    for line in rate_doubts(rate):
        warnings.warn(line, stacklevel=3)
    if not len(sightings):
        return
    last = int(sightings.frame.max())
    if last >= frames:
        raise InputError(
            f"frames is {frames}, but corners are seen up to frame {last}; expected the number of "
            "frames that they were followed through"
        )
    require_lens(lens, float(sightings.pixels.max()) / sightings.scale)


def require_direction(start: Array) -> None:
    """Refuse what is no unit vector (3,).

    Raises:
        InputError: it has another length, which angles are taken with.
    """
    require_shape(start, "start", (3,), "a unit vector")
    length = float(np.linalg.norm(start))
    if not abs(length - 1) < _OFF:
        raise InputError(f"start has length {length:.4g}, expected a unit vector: divide by it")


def require_deviation(deviation: float) -> None:
    """Refuse a deviation of a direction that is none in radians.

    Raises:
        InputError: it is not above zero, or above a right angle, as degrees are.
    """
    if not 0 < deviation <= math.pi / 2:
        raise InputError(
            f"deviation is {deviation:.4g}, expected radians, above zero, at most a right angle: "
            "math.radians converts degrees"
        )


def require_rotation(rotation: Array) -> None:
    """Refuse what is no rotation (3, 3).

    Raises:
        InputError: rows are not at right angles and of unit length, or it is a mirror image.
    """
    require_shape(rotation, "rotation", (3, 3), "world to camera")
    skewed = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if not skewed < _SKEWED or not np.linalg.det(rotation) > 0:
        raise InputError(
            f"rotation is none (rows off a right angle or unit length by {skewed:.2g}, or a mirror "
            "image); expected world to camera, OpenCV axes"
        )
