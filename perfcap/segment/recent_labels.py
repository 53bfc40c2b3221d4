"""Pictures of labels that were decoded not long ago.

Every stage looks at a mask several times, from contours to overlaps. Unpacking its PNG takes 2 ms
at 1000x1000, most of them for the empty part of the picture; the part with somebody in it takes a
few kilobytes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Labels = NDArray[np.uint8]

_ROOM = 8 << 20  # bytes, of all pictures that are kept


@dataclass(frozen=True)
class _Picture:
    """Labels as they are kept: the part of the picture that is not empty, and in bits if it can."""

    shape: tuple[int, ...]
    part: tuple[slice, slice]
    bits: bool
    data: NDArray[np.uint8]

    @classmethod
    def of(cls, labels: Labels) -> _Picture:
        left, top, width, height = cv2.boundingRect(labels)
        part = slice(top, top + height), slice(left, left + width)
        inside = labels[part]
        bits = bool(inside.max(initial=0) <= 1)
        return cls(labels.shape, part, bits, np.packbits(inside) if bits else inside.copy())

    def labels(self) -> Labels:
        labels = np.zeros(self.shape, np.uint8)
        inside = labels[self.part]
        inside[...] = (
            np.unpackbits(self.data, count=inside.size).reshape(inside.shape)
            if self.bits
            else self.data
        )
        return labels


class RecentLabels:
    """Labels by their PNG, those that were asked for last; threads may share it."""

    def __init__(self, room: int = _ROOM) -> None:
        self._room, self._used = room, 0
        self._pictures: OrderedDict[bytes, _Picture] = OrderedDict()
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._room,)  # copies begin with nothing

    def labels(self, png: bytes, decode: Callable[[bytes], Labels]) -> Labels:
        """Labels (H, W) of a PNG, to be written to as one likes."""
        with self._lock:
            known = self._pictures.get(png)
            if known is not None:
                self._pictures.move_to_end(png)
        if known is not None:
            return known.labels()
        labels = decode(png)
        self._keep(png, _Picture.of(labels))
        return labels

    def _keep(self, png: bytes, picture: _Picture) -> None:
        with self._lock:
            if png in self._pictures:
                return
            self._pictures[png] = picture
            self._used += picture.data.nbytes
            while self._used > self._room:
                self._used -= self._pictures.popitem(last=False)[1].data.nbytes
