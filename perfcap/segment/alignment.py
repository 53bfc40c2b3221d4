"""What registration leaves: small shifts that no one homography describes, and exposure.

A camera that is carried sees near things move against far ones (parallax). Where both pictures show
the background, dense optical flow (Kroeger et al. 2016) says by how much; behind the person the
shift is that of what surrounds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.trimap import Mask
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]

_LEAST = 200  # pixels that both pictures show
_SMALLEST = 32  # px of the shorter side, below which optical flow has no scales to work on
_PATCH = 9  # px of the shrunk pictures
_SAMPLES = 8000  # pixels looked at for exposure
_DARK = 16  # grey levels below which a ratio says nothing about exposure
_WEIGHT = 0.2  # share of a neighbourhood that must be visible to go by it


@dataclass(frozen=True)
class AlignmentSettings(Settings):
    """How a picture is bent onto another.

    Attributes:
        side: px, pictures are shrunk to this longest side for the flow.
        smooth: standard deviations of the neighbourhoods over which flow is averaged, as shares
            of the longest side; the next one where the first shows too little background.
        most: px of the shrunk pictures; more is no parallax but a mistake.
    """

    side: int = 400
    smooth: tuple[float, ...] = (0.02, 0.06, 0.2)
    most: float = 8.0


def find_shifts(
    target: Image, source: Image, visible: Mask, settings: AlignmentSettings
) -> Plane | None:
    """Where to look in ``source`` for what ``target`` shows, as shifts (h, w, 2), px.

    Args:
        target: (h, w, 3) RGB.
        source: the same scene, registered, (h, w, 3).
        visible: pixels that show background in both, (h, w).
        settings: of the flow.

    Returns:
        Shifts everywhere, smooth; None where there is nothing to gain.
    """
    if int(visible.sum()) < _LEAST:
        return None
    scale = min(1.0, settings.side / max(target.shape[:2]))
    gray = [_gray(picture, scale) for picture in (target, source)]
    size = gray[0].shape[::-1]
    if min(size) < _SMALLEST:
        return None
    seen = cv2.resize(visible.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    dense = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    # zeros to begin with: what is passed is taken for a first guess
    flow = dense.calc(gray[0], gray[1], np.zeros((*gray[0].shape, 2), np.float32))
    length = np.hypot(flow[..., 0], flow[..., 1])
    seen = cv2.erode(seen, np.ones((_PATCH, _PATCH), np.uint8))  # flow is that of whole patches
    weight = np.where(length < settings.most, seen * (seen > 0.5), 0).astype(np.float32)
    shifts = fill(flow, weight, [share * max(size) for share in settings.smooth])
    bent = _bent(gray[1], shifts)
    before, after = (_difference(gray[0], other, weight) for other in (gray[1], bent))
    if not after < before:
        return None
    large: Plane = cv2.resize(shifts / scale, target.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return large


def match_exposure(target: Image, source: Image, visible: Mask) -> Image:
    """``source`` as bright as ``target`` in each channel, by the median ratio where ``visible``."""
    chosen = np.flatnonzero(visible)
    if len(chosen) < _LEAST:
        return source
    chosen = chosen[:: -(-len(chosen) // _SAMPLES)]
    seen, other = (
        picture.reshape(-1, 3)[chosen].astype(np.float32) for picture in (target, source)
    )
    gains = np.ones(3, np.float32)
    for channel in range(3):
        bright = other[:, channel] > _DARK
        if int(bright.sum()) >= _LEAST:
            gains[channel] = np.median(seen[bright, channel] / other[bright, channel])
    table = np.rint(np.clip(np.arange(256)[:, None] * gains, 0, 255)).astype(np.uint8)
    return np.asarray(cv2.LUT(source, table[None]), np.uint8)


def _gray(picture: Image, scale: float) -> Image:
    gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(gray, np.uint8)


def fill(values: Plane, weight: Plane, deviations: list[float]) -> Plane:
    """Weighted means of values (h, w, n), over the smallest neighbourhood that shows enough.

    Args:
        values: (h, w, n).
        weight: how much of a pixel is visible, (h, w).
        deviations: of the Gaussian neighbourhoods, px, rising.
    """
    levels = []
    for deviation in deviations:
        share = _blur(weight, deviation)
        mean = _blur(values * weight[..., None], deviation) / np.maximum(share, 1e-6)[..., None]
        levels.append((mean, share))
    found = levels[-1][0]
    for mean, share in reversed(levels[:-1]):
        trust = np.clip(share / _WEIGHT, 0, 1)[..., None]
        found = trust * mean + (1 - trust) * found
    filled: Plane = found.astype(np.float32)
    return filled


def _blur(plane: Plane, deviation: float) -> Plane:
    """A Gaussian, wide ones on a shrunk plane."""
    step = max(1, int(deviation / 3))
    size = plane.shape[1::-1]
    small = cv2.resize(
        plane, (max(1, size[0] // step), max(1, size[1] // step)), interpolation=cv2.INTER_AREA
    )
    small = cv2.GaussianBlur(small, (0, 0), deviation / step, borderType=cv2.BORDER_REPLICATE)
    blurred: Plane = cv2.resize(small, size, interpolation=cv2.INTER_LINEAR)
    return blurred


def _bent(picture: Image, shifts: Plane) -> Image:
    rows, columns = np.indices(shifts.shape[:2], np.float32)
    at = columns + shifts[..., 0], rows + shifts[..., 1]
    return np.asarray(cv2.remap(picture, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _difference(one: Image, other: Image, weight: Plane) -> float:
    apart = cv2.absdiff(one, other)[weight > 0]
    return float(apart.mean()) if len(apart) else 0.0
