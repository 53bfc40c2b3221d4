"""Frames of a video that checks look at, wherever the person is: decoded once for all of them."""

from __future__ import annotations

import numpy as np

from perfcap.io.doctor.fields import field_frames
from perfcap.io.doctor.footage import blank_frames
from perfcap.io.doctor.rest import rest_frames
from perfcap.io.doctor.shots import anchor_frames

_IMAGES = 4  # evenly spread, in which the vertical is looked for


def gravity_frames(count: int) -> list[int]:
    """Frames of a clip of so many in which straight edges say which way is up."""
    index: list[int] = np.unique(np.linspace(0, count - 1, _IMAGES).round().astype(int)).tolist()
    return index


def fixed_frames(count: int, rate: float) -> list[int]:
    """Frames of a clip that are looked at again after joints were found in all of them.

    Args:
        count: frames of the clip.
        rate: frames a second.
    """
    looks = (
        blank_frames(count),
        field_frames(count),
        rest_frames(count, rate),
        anchor_frames(count, rate),
        gravity_frames(count),
    )
    return sorted({frame for look in looks for frame in look})
