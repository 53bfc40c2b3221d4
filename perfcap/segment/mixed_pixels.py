"""Pixels on the boundary, where person and background mix.

A colour that is half person is like neither side, so a mask tends to take it. Where the background
is known the share of each side can be told: the pixel's colour lies between the person's a little
further in and the plate's.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_shape
from perfcap.segment import _mixed_numba
from perfcap.segment.evidence import Backdrop
from perfcap.segment.trimap import Mask, bounds

_REACH = 3  # px within which pure colours are looked for
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

    Raises:
        InputError: arrays of other shapes than the mask's.
    """
    require_shape(image, "image", (*inside.shape, 3), "(h, w, 3) of the mask's part")
    for name, other in (("plate", backdrop.plate.known), ("open pixels", open_)):
        require_shape(other, name, inside.shape, "(h, w) of the mask's part")
    settled = inside.copy()
    part = bounds(open_, 2 * _REACH)  # whether a pixel is pure depends on the nearest ones alone
    if part[0].start == part[0].stop:
        return settled
    image, plate, open_ = image[part], backdrop.plate[part], open_[part]
    changed = inside[part].copy()
    side = _pure_side(changed)
    pixels = np.argwhere((side == 0) & open_)
    _mixed_numba.settle(
        pixels,
        np.ascontiguousarray(image),
        np.ascontiguousarray(plate.color),
        backdrop.lighting.gain,
        np.ascontiguousarray(plate.known),
        side,
        (_REACH, _APART**2, _SLACK, _BEYOND),
        changed,
    )
    settled[part] = changed
    return settled


def _pure_side(inside: Mask) -> NDArray[np.int8]:
    """1 where a mask (h, w) holds all nine pixels around one, -1 where none of them, else 0."""
    pixels, around = inside.view(np.uint8), np.ones((3, 3), np.uint8)
    all_, any_ = cv2.erode(pixels, around), cv2.dilate(pixels, around)
    side: NDArray[np.int8] = all_.view(np.int8) + any_.view(np.int8) - np.int8(1)
    return side
