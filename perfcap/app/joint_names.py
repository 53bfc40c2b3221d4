"""Joints of a network that lie where others are: their names in its manifest are exchanged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from perfcap.detect.joint_set import LANDMARKS

Floats = NDArray[np.float64]

_THERE = 0.05  # of the person, in the median; right joints of the shipped networks are 0.04 off
_FARTHER = 2.0  # times as far from where they should be


def misnamed(points: Floats, truth: Floats, absent: Sequence[str]) -> tuple[str, ...]:
    """Sentences such as "l_wrist is where r_wrist is".

    Args:
        points: landmarks that a network sees, (F, 16, 2), pixels; NaN where it sees none.
        truth: where they are, (F, 16, 2).
        absent: landmarks that are not among the network's joints.
    """
    size = np.ptp(truth, axis=1).max(-1)[:, None, None]
    apart = np.linalg.norm(points[:, :, None] - truth[:, None], axis=-1) / size
    usual = np.median(np.nan_to_num(apart, nan=1.0), axis=0)  # seen, true
    told = []
    for own, name in enumerate(LANDMARKS):
        there = int(usual[own].argmin())
        near, far = usual[own, there], usual[own, own]
        if name not in absent and near < _THERE and far > max(_THERE, _FARTHER * near):
            told.append(f"{name} is where {LANDMARKS[there]} is")
    return tuple(told)
