"""Antialiased marks on an image: round-ended strokes, borders of regions, a line of text.

A mark is a coverage in [0, 1] computed from a distance in pixels, so that widths need not be whole
numbers and positions are exact to a fraction of a pixel. Images are changed in place.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]
Coverage = NDArray[np.float32]
Color = tuple[int, int, int]
Box = tuple[slice, slice]

FURTHEST = 1e4  # px; strokes that end further outside are left out


def stroke(
    image: Image, segments: Floats, radius: float, color: Color, opacity: float | Floats = 1.0
) -> None:
    """Draw round-ended strokes; where strokes of one call overlap, the most opaque one counts.

    Args:
        image: (H, W, 3), changed.
        segments: both ends of each stroke, (S, 2, 2) px x y; equal ends make a dot. Strokes that
            are not finite are left out.
        radius: half the width of a stroke, px.
        color: RGB.
        opacity: of all strokes, or (S,) of each.
    """
    opacity = np.broadcast_to(opacity, len(segments))
    drawn = (np.abs(segments) < FURTHEST).all((1, 2))  # False for NaN
    if not drawn.any():
        return
    segments, opacity = segments[drawn], opacity[drawn]
    outer = _box(segments, radius, image.shape)
    layer = np.zeros(image[outer].shape[:2], np.float32)
    origin = np.array([outer[1].start, outer[0].start])
    for ends, strength in zip(segments - origin, opacity, strict=True):
        inner = _box(ends, radius, layer.shape)
        covered = strength * np.clip(radius + 0.5 - _distance(ends, inner), 0, 1)
        layer[inner] = np.maximum(layer[inner], covered)
    blend(image[outer], layer, color)


def border_distance(mask: Coverage, smoothing: float, reach: float) -> tuple[Box, Floats]:
    """Distance in pixels to the border of a region (H, W) given as coverage.

    Args:
        mask: coverage in [0, 1].
        smoothing: standard deviation of the blur that rounds off the staircase of a mask, px.
        reach: distances are right up to here, and up to three times the smoothing.

    Returns:
        The rows and columns around the region, and the distance inside them.
    """
    points = cv2.boundingRect((mask > 0).astype(np.uint8))
    corners = np.array([points[:2], np.add(points[:2], points[2:]) - 1], np.float64)
    box = _box(corners, reach + 3 * smoothing, mask.shape)
    # the blurred edge of a half plane is a normal distribution function of the distance to it
    blurred = cv2.GaussianBlur(mask[box], (0, 0), smoothing, borderType=cv2.BORDER_REPLICATE)
    return box, smoothing * np.abs(ndtri(np.clip(blurred, 1e-4, 1 - 1e-4)))


def text(image: Image, line: str, corner: tuple[float, float], height: float, color: Color) -> None:
    """Write a line whose lower left corner is given, x y; ``height`` is about a capital's, px."""
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, height / 21
    layer = np.zeros(image.shape[:2], np.uint8)
    place = (round(corner[0]), round(corner[1]))
    thickness = max(1, round(height / 11))
    cv2.putText(layer, line, place, font, scale, (255,), thickness, cv2.LINE_AA)
    blend(image, layer.astype(np.float32) / 255, color)


def text_width(line: str, height: float) -> int:
    """Width in pixels of a line that ``text`` writes."""
    (width, _), _ = cv2.getTextSize(
        line, cv2.FONT_HERSHEY_SIMPLEX, height / 21, max(1, round(height / 11))
    )
    return int(width)


def blend(image: Image, coverage: NDArray[np.floating], color: Color) -> None:
    """Lay a colour over an image (H, W, 3) by a coverage (H, W)."""
    share = coverage[..., None].astype(np.float32)
    mixed = image + share * (np.array(color, np.float32) - image)
    np.copyto(image, np.rint(mixed).astype(np.uint8))


def _distance(ends: Floats, box: Box) -> Floats:
    """Distance of the pixel centres of a box to a segment (2, 2), px."""
    row, column = np.ogrid[box]
    start, along = ends[0], ends[1] - ends[0]
    x, y = column - start[0], row - start[1]
    length = max(float(along @ along), 1e-12)
    share = np.clip((x * along[0] + y * along[1]) / length, 0, 1)
    distance: Floats = np.hypot(x - share * along[0], y - share * along[1])
    return distance


def _box(points: Floats, margin: float, shape: tuple[int, ...]) -> Box:
    """Rows and columns within a margin of points (..., 2), cut to an image's shape."""
    flat = points.reshape(-1, 2)
    low = np.floor(flat.min(0) - margin - 1).astype(int)
    high = np.ceil(flat.max(0) + margin + 2).astype(int)
    (left, top), (right, bottom) = np.maximum(low, 0), np.maximum(high, 0)
    rows = slice(min(top, shape[0]), min(bottom, shape[0]))
    return rows, slice(min(left, shape[1]), min(right, shape[1]))
