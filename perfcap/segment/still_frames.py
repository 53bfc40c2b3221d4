"""Sharp frames of a video, evenly spread over what it shows: stills for photogrammetry."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

_SIDE = 640  # px, the longest side of the images that are looked at
_CORNERS = 300
_MIDDLE = (0.25, 0.75)  # of the width: where the person is, and moves on a turntable
_LEAST = 12  # corners that must be found again
_LOST = 0.05  # share of the image by which a frame moved that shows none of the corners again
_CENTRAL = 0.8  # of each stretch is looked at, so that neighbours stay apart


@dataclass(frozen=True)
class Stills:
    """What frames look like.

    Attributes:
        sharpness: mean squared slope of the grey image over its variance, (F,): to be compared
            between frames that show nearly the same.
        travel: how far the picture moved since the first frame, shares of its longest side, (F,).
    """

    sharpness: Floats
    travel: Floats


def look_over(frames: Iterable[Image]) -> Stills:
    """Sharpness and travel of frames (H, W, 3) RGB, in order.

    Travel is the median displacement of corners in the middle of the image from each frame to the
    next, added up: a camera around a person and a person on a turntable both have it.
    """
    sharpness, steps = [], []
    previous: Image | None = None
    for frame in frames:
        gray = _small(frame)
        sharpness.append(_sharpness(gray))
        steps.append(0.0 if previous is None else _displacement(previous, gray))
        previous = gray
    return Stills(np.array(sharpness), np.cumsum(steps))


def choose_stills(stills: Stills, count: int) -> list[int]:
    """The sharpest frame of each of ``count`` stretches of equal travel, increasing.

    Fewer come back where the video is shorter, or stands still.
    """
    travel, total = stills.travel, float(stills.travel[-1])
    count = min(count, len(travel))
    if total <= 0:
        return [int(stills.sharpness.argmax())]
    place = travel / total * count
    chosen = []
    for stretch in range(count):
        off = np.abs(place - stretch - 0.5)
        inside = np.nonzero(off <= _CENTRAL / 2)[0]
        if not len(inside):  # the camera passed it within a frame
            inside = np.array([off.argmin()])
        chosen.append(int(inside[stills.sharpness[inside].argmax()]))
    return sorted(set(chosen))


def blurred(stills: Stills, chosen: list[int], share: float = 0.5) -> list[int]:
    """Those of the chosen frames that are less sharp than a share of the median of the chosen."""
    level = share * float(np.median(stills.sharpness[chosen]))
    return [frame for frame in chosen if stills.sharpness[frame] < level]


def _small(frame: Image) -> Image:
    gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
    scale = min(1.0, _SIDE / max(gray.shape))
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(gray, np.uint8)


def _sharpness(gray: Image) -> float:
    values = gray.astype(np.float32)
    # blurs of less than a pixel matter little; noise would look sharp without the smoothing
    values = cv2.GaussianBlur(values, (0, 0), 0.7)
    slope = cv2.Laplacian(values, cv2.CV_32F)
    return float(np.square(slope).mean() / max(float(values.var()), 1.0))


def _displacement(one: Image, other: Image) -> float:
    """Median displacement of corners, as a share of the image's longest side."""
    mask = np.zeros_like(one)
    left, right = (int(share * one.shape[1]) for share in _MIDDLE)
    mask[:, left:right] = 1
    corners = cv2.goodFeaturesToTrack(one, _CORNERS, 0.01, 5, mask=mask)
    if corners is None:
        return 0.0
    moved, found, _ = cv2.calcOpticalFlowPyrLK(one, other, corners, None, winSize=(15, 15))
    ok = found.ravel() > 0
    if int(ok.sum()) < _LEAST:
        return _LOST if len(corners) >= _LEAST else 0.0
    length = np.linalg.norm((moved - corners)[ok].reshape(-1, 2), axis=1)
    return float(np.median(length) / max(one.shape))
