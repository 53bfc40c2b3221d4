"""Bars beside a picture that was fitted into a wider or higher video.

They have one colour, or are filled with a blurred copy of the picture.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_picture

_EVEN = 24  # of 255: by which a bar differs, in all its pixels and images, as compression leaves it
_EDGE = 0.02  # of the longer side: corners that are nearer see the bar's edge, which stands still
_ALIKE = 0.01  # of the longer side, by which two bars differ in width
_MOST = 0.8  # of the image; more is no picture with bars
# Of bars that are filled: size at which they are looked for, and their widths, of the side
_LOOKED, _WIDTHS = 640, (0.08, 0.4)
# Times what neighbouring columns differ in bars, that they do at both seams; roughness of the bars
# of the picture's; correlation with its copy. Recordings as they are stay far from the first two;
# cut and filled they pass all three, but for blurs by a pixel or two.
_SEAM, _SMOOTH, _COPY = 6.0, 0.7, 0.7
_LEAST = 1.0  # of 255: what is evener than this is no seam
_BLOCKS = 24  # rows that are compared


def find_bars(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.bool_]:
    """Where bars are, and the edge of the picture beside them, (H, W); False where none are.

    Args:
        images: (H, W, 3) each, some of a video.
    """
    size = images[0].shape[:2]
    found = np.zeros(size, np.bool_)
    edge = round(_EDGE * max(size))
    spans = _spans(images)
    if spans is None:
        return found
    for axis, (first, last) in enumerate(spans):
        across = np.ones(size[axis], np.bool_)
        across[first + edge * (first > 0) : last - edge * (last < size[axis])] = False
        found |= across[:, None] if axis == 0 else across[None]
    return found if found.mean() < _MOST else np.zeros(size, np.bool_)


def picture_size(images: Sequence[NDArray[np.uint8]]) -> tuple[int, int]:
    """Height and width of a picture in the middle between two bars; without such, of the images.

    Bars are on two sides alone, and as wide: other even borders are those of a plain background.

    Args:
        images: (H, W, 3) each, some of a video.
    """
    height, width = images[0].shape[:2]
    size, spans = (height, width), _spans(images) or ((0, height), (0, width))
    narrower = [axis for axis in (0, 1) if spans[axis] != (0, size[axis])]
    if len(narrower) != 1:
        return size
    first, last = spans[narrower[0]]
    if abs(first - (size[narrower[0]] - last)) > _ALIKE * max(size):
        return size
    return (last - first, width) if narrower == [0] else (height, last - first)


def _spans(images: Sequence[NDArray[np.uint8]]) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """First row behind bars and first of those after it, and columns; None of one colour."""
    for number, image in enumerate(images):
        require_picture(image, f"image {number}", images[0].shape[:2])
    low = np.minimum.reduce([image.min(-1) for image in images])
    high = np.maximum.reduce([image.max(-1) for image in images])
    found = []
    for axis in (0, 1):
        even = high.max(1 - axis).astype(int) - low.min(1 - axis) < _EVEN
        if even.all():
            return None
        found.append((int(np.argmin(even)), len(even) - int(np.argmin(even[::-1]))))
    rows, columns = found
    if (rows, columns) == ((0, low.shape[0]), (0, low.shape[1])):
        scale = min(1.0, _LOOKED / max(low.shape))
        small = [_gray(image, scale) for image in images]
        across = _filled(small)
        down = None if across else _filled([np.ascontiguousarray(each.T) for each in small])
        columns = columns if across is None else _enlarged(across, scale)
        rows = rows if down is None else _enlarged(down, scale)
    return rows, columns


def _gray(image: NDArray[np.uint8], scale: float) -> NDArray[np.float32]:
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), np.float32)


def _enlarged(span: tuple[int, int], scale: float) -> tuple[int, int]:
    return round(span[0] / scale), round(span[1] / scale)


def _filled(images: Sequence[NDArray[np.float32]]) -> tuple[int, int] | None:
    """First column between bars of a blurred copy of the picture and first of those after it."""
    width = images[0].shape[1]
    least, most = (round(share * width) for share in _WIDTHS)
    # most rows differ at a seam, whatever stands at the same distance from both edges
    steps = np.mean([np.median(np.abs(np.diff(image, axis=1)), 0) for image in images], 0)
    rough = np.mean([np.abs(np.diff(image, axis=0)).mean(0) for image in images], 0)
    seams = np.minimum(steps[least - 1 : most - 1], steps[::-1][least - 1 : most - 1])
    first = least + int(np.argmax(seams))
    last = width - first
    bars = np.r_[3 : first - 2, last + 2 : width - 3]
    if seams.max() < max(_LEAST, _SEAM * float(np.median(steps[bars - 1]))):
        return None
    if rough[bars].max() > _SMOOTH * rough[first + 1 : last - 1].mean():
        return None
    likeness = max(_likeness(images, first, last, stretched) for stretched in (False, True))
    return (first, last) if likeness > _COPY else None


def _likeness(
    images: Sequence[NDArray[np.float32]], first: int, last: int, stretched: bool
) -> float:
    """Correlation of bars with the picture as large as the video, as high as it or cut."""
    height, width = images[0].shape
    tall = height if stretched else round(height * width / (last - first))
    top = (tall - height) // 2
    size = max(2, first * _BLOCKS // height), _BLOCKS
    pairs = []
    for image in images:
        copy = cv2.resize(image[:, first:last], (width, tall), interpolation=cv2.INTER_AREA)
        for each in (copy[top : top + height], image):
            parts = each[:, :first], each[:, last:]
            pairs += [cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in parts]
    blocks = np.array(pairs).reshape(len(images), 2, -1)
    copies, shown = (blocks[:, which].ravel() for which in (0, 1))
    if min(copies.std(), shown.std()) < _LEAST:
        return 0.0
    return float(np.corrcoef(copies, shown)[0, 1])
