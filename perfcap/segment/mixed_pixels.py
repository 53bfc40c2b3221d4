"""Pixels on the boundary, where person and background mix.

A colour that is half person is like neither side, so a mask tends to take it. Where the
background is known the share of each side can be told: the pixel's colour lies between the
person's a little further in and the plate's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.segment import _mixed_numba
from perfcap.segment.evidence import Backdrop
from perfcap.segment.trimap import Mask, bounds, signed_distance

_REACH = 3  # px within which pure colours are looked for
_PURE = 1.1  # px from the boundary
_APART = 30.0  # grey levels by which two sides must differ
_SLACK = 0.1  # of a share around a half that decides nothing
_BEYOND = 0.2  # by which a share may leave [0, 1]; further out the pixel is no mixture


def settle_mixed(inside: Mask, image: NDArray[np.uint8], backdrop: Backdrop, open_: Mask) -> Mask:
    """The mask (h, w) with every mixed pixel on the side it has more of.

    Args:
        inside: the mask.
        image: (h, w, 3) RGB.
        backdrop: the plate, and how it is lit.
        open_: pixels that may change, (h, w).
    """
    settled = inside.copy()
    part = bounds(open_, 2 * _REACH)  # whether a pixel is pure depends on the nearest ones alone
    image, plate, open_ = image[part], backdrop.plate[part], open_[part]
    distance = signed_distance(inside[part])
    pixels = np.argwhere((np.abs(distance) <= _PURE) & open_)
    changed = inside[part].copy()
    _mixed_numba.settle(
        pixels,
        np.ascontiguousarray(image),
        plate.color * backdrop.lighting.gain,
        np.ascontiguousarray(plate.known),
        distance,
        (_REACH, _PURE, _APART**2, _SLACK, _BEYOND),
        changed,
    )
    settled[part] = changed
    return settled
