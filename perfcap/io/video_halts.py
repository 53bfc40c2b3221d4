"""Frames of a video that show the picture of the frame before once more.

Converters repeat pictures to reach a rate, webcams where they have no new one, and streams that
stall hold one for a while. A picture that is stored again differs from itself by what compression
leaves, which is far less than what somebody who moves changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SIDE = 160  # samples of the longer side that are looked at
_BLOCK = 8  # samples of a block's side
# Grey levels of 255, of the block that differs most: encoders leave 0.1 to 2.5 of a picture that is
# there again, twice as much of dark or noisy ones at low rates; the slowest frame of recorded
# people has 3. Of few frames in a row, the motion about them says enough.
_SAME, _ALIKE, _FEW = 2.5, 5.0, 3
# Who comes to rest does so within some frames; a picture that is held stops the motion at once
_AT_ONCE = 5.0


class PictureSteps:
    """How much each decoded frame differs from the one before.

    Attributes:
        sizes: mean difference in grey levels of 255 of the block that differs most, one for each
            frame but the first.
    """

    def __init__(self) -> None:
        self.sizes: list[float] = []
        self._last: NDArray[np.int16] | None = None

    def add(self, frame: Any) -> None:
        """Look at the next frame of ``av``, of the size of the others."""
        now = _samples(frame)
        if self._last is not None:
            self.sizes.append(_difference(now, self._last))
        self._last = now


def _samples(frame: Any) -> NDArray[np.int16]:
    """Some pixels of the first plane, which is brightness in nearly all videos."""
    bits = frame.format.components[0].bits
    plane, deep = frame.planes[0], bits > 8
    rows = np.frombuffer(plane, np.uint16 if deep else np.uint8)
    rows = rows.reshape(plane.height, -1)
    step = max(1, max(frame.height, frame.width) // _SIDE)
    some = rows[::step, : frame.width : step]
    return (some >> (bits - 8) if deep else some).astype(np.int16)


def _difference(one: NDArray[np.int16], other: NDArray[np.int16]) -> float:
    off = np.abs(one - other)
    height, width = (size // _BLOCK * _BLOCK for size in off.shape)
    if not height or not width:
        return float(off.mean())
    blocks = off[:height, :width].reshape(height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK)
    return float(blocks.mean((1, 3)).max())


def halted(sizes: Sequence[float]) -> NDArray[np.bool_]:
    """Which frames (F,) show the frame before again, between others that move.

    Args:
        sizes: as of ``PictureSteps``, F - 1.
    """
    steps = np.asarray(sizes, np.float64)
    found = np.zeros(len(steps) + 1, np.bool_)
    for most, longest in ((_SAME, len(steps)), (_ALIKE, _FEW)):
        edges = np.flatnonzero(np.diff([False, *(steps < most), False]))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            beside = [float(steps[at]) for at in (start - 1, stop) if 0 <= at < len(steps)]
            at_once = beside and min(beside) > _AT_ONCE * float(steps[start:stop].max())
            if at_once and stop - start <= longest:
                found[start + 1 : stop + 1] = True
    return found
