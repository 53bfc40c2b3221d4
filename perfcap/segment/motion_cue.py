"""What changed between adjacent frames (Xu 2018, Sec. 5.1).

A person moves; what lies behind changes little, or as one plane when the camera moves. Neighbours
that hardly changed belong together. The gradient is measured in units of the background's own
change, so that noise, compression and what registration leaves do not count as motion; where the
background changes as much as a person could, the cue says nothing and is switched off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.trimap import Mask
from perfcap.setting_checks import Settings

Plane = NDArray[np.float32]
Image = NDArray[np.uint8]

_THUMBNAIL = (32, 32)
_ROWS = 256  # of an image, that are looked at for cuts
_BINS = 8  # a channel
_LEAST_RING = 100  # pixels


@dataclass(frozen=True)
class MotionSettings(Settings):
    """When a pixel counts as changed.

    Attributes:
        scale: multiples of the background's median change that are motion.
        noise: least median change of the background, grey levels.
        unsteady: median change of the background, grey levels, that switches the cue off.
        blur: standard deviation of the smoothing, px.
    """

    scale: float = 3.0
    noise: float = 2.0
    unsteady: float = 12.0
    blur: float = 1.0


@dataclass(frozen=True)
class MotionCue:
    """Temporal gradient around one person in one frame.

    Attributes:
        gradient: (h, w), in units of what counts as motion; None where the cue is off.
        level: median change of the surroundings, grey levels, NaN without adjacent frames.
    """

    gradient: Plane | None
    level: float


def temporal_gradient(
    image: Plane, adjacent: Sequence[Plane], surroundings: Mask, settings: MotionSettings
) -> MotionCue:
    """How much each pixel changed since, and until, the adjacent frames.

    The lesser of the two changes counts: ground that the person just left, or is about to cover,
    changes only once.

    Args:
        image: colours (h, w, 3).
        adjacent: the same part of the previous and the next frame, registered where the camera
            moves. May be empty.
        surroundings: (h, w), surely background.
        settings: of the cue.
    """
    if not adjacent or int(surroundings.sum()) < _LEAST_RING:
        return MotionCue(None, float("nan"))
    change = _change(image, adjacent[0])
    for other in adjacent[1:]:
        change = np.minimum(change, _change(image, other))
    smooth = cv2.GaussianBlur(change, (0, 0), settings.blur)
    level = float(np.median(smooth[surroundings]))
    if level > settings.unsteady:
        return MotionCue(None, level)
    unit = np.float32(settings.scale * max(level, settings.noise))
    return MotionCue(smooth / unit, level)


def _change(image: Plane, other: Plane) -> Plane:
    difference = image - other
    change: Plane = np.sqrt(np.einsum("...c,...c->...", difference, difference))
    return change


@dataclass(frozen=True)
class CutSettings(Settings):
    """When two adjacent frames are of different shots: both measures exceed their limits.

    Attributes:
        change: mean difference of thumbnails, grey levels.
        colors: share of pixels whose colours the other frame does not have.
    """

    change: float = 25.0
    colors: float = 0.35


def find_cuts(images: Sequence[Image], settings: CutSettings | None = None) -> set[int]:
    """Numbers of the frames (H, W, 3) before which the scene changes.

    A moving camera keeps most colours, a flickering light keeps the picture's structure; a cut
    keeps neither.
    """
    settings = settings or CutSettings()
    # some of the rows say as much, and looking at every pixel takes long
    small = [_thumbnail(frame[:: max(1, len(frame) // _ROWS)]) for frame in images]
    return {i for i in range(1, len(small)) if _is_cut(small[i - 1], small[i], settings)}


def _is_cut(one: Plane, following: Plane, settings: CutSettings) -> bool:
    levels = [frame - frame.mean((0, 1)) for frame in (one, following)]
    change = float(np.abs(levels[0] - levels[1]).mean())
    if change <= settings.change:
        return False
    before, after = (_histogram(frame) for frame in (one, following))
    return bool(1 - np.minimum(before, after).sum() > settings.colors)


def _thumbnail(image: Image) -> Plane:
    small: Plane = cv2.resize(image, _THUMBNAIL, interpolation=cv2.INTER_AREA).astype(np.float32)
    return small


def _histogram(image: Plane) -> NDArray[np.float64]:
    bins = np.minimum(image.reshape(-1, 3) * (_BINS / 256), _BINS - 1).astype(np.int64)
    index = (bins[:, 0] * _BINS + bins[:, 1]) * _BINS + bins[:, 2]
    return np.bincount(index, minlength=_BINS**3) / len(index)
