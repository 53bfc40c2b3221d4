"""What was captured, drawn over the frame it was captured from.

Every mark has a dark halo, so that it reads on bright and on busy frames, and its width follows
the image. The right side of the body is orange, the left side blue, the middle nearly white.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from perfcap.errors import InputError
from perfcap.setting_checks import Settings

# --- Antialiased marks on an image: round-ended strokes, borders of regions, a line of text -------
#
# A mark is a coverage in [0, 1] computed from a distance in pixels, so that widths need not be
# whole numbers and positions are exact to a fraction of a pixel. Images are changed in place.

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


# --- What was captured, drawn over the frame it was captured from ---------------------------------

LANDMARKS = 16  # head_top, neck, arms, legs: the order of the detector
HIPS = (8, 12)
PELVIS = 16  # middle of the hips, appended to the landmarks
MIDDLE = ((0, 1), (1, PELVIS))
RIGHT = ((1, 2), (2, 3), (3, 4), (PELVIS, 8), (8, 9), (9, 10), (10, 11))
LEFT = ((1, 5), (5, 6), (6, 7), (PELVIS, 12), (12, 13), (13, 14), (14, 15))
BLACK = (0, 0, 0)


@dataclass(frozen=True)
class OverlayStyle(Settings):
    """Looks of an overlay; lengths are in pixels of a frame 720 px high and scale with it.

    Attributes:
        outline: colour of the silhouette's outline and tint, RGB.
        outline_width: width of the outline, 0 for none.
        tint: opacity of the colour over the silhouette, 0 to 1.
        right, left, middle: colours of the skeleton, RGB.
        stick_width: width of its sticks.
        joint_radius: radius of its dots.
        detection: colour of detections, RGB.
        detection_arm: length of each of a cross's four arms.
        detection_width: width of the arms.
        halo: opacity of the dark seam around marks, 0 to 1.
        halo_width: how far it reaches beyond them.
        caption_height: height of a capital letter.
    """

    outline: Color = (255, 236, 92)
    outline_width: float = 2.2
    tint: float = 0.0
    right: Color = (255, 138, 36)
    left: Color = (58, 160, 255)
    middle: Color = (236, 228, 255)
    stick_width: float = 3.2
    joint_radius: float = 3.6
    detection: Color = (255, 255, 255)
    detection_arm: float = 5.0
    detection_width: float = 1.6
    halo: float = 0.55
    halo_width: float = 1.6
    caption_height: float = 13.0


def draw_overlay(
    frame: Image,
    mask: NDArray[np.generic] | None = None,
    joints: NDArray[np.floating] | None = None,
    detections: NDArray[np.floating] | None = None,
    confidence: NDArray[np.floating] | None = None,
    style: OverlayStyle = OverlayStyle(),
) -> Image:
    """Draw outline, skeleton and detections onto a copy of a frame.

    Args:
        frame: (H, W, 3) uint8 RGB.
        mask: silhouette, (H, W), bool or coverage in [0, 1].
        joints: the 16 landmarks, (16, 2) px, pixel centres at integers. Those that are not finite
            are left out with their sticks.
        detections: (16, 2) px, drawn as crosses.
        confidence: (16,) in [0, 1], opacity of the crosses; all are opaque if None.
        style: colours and widths.

    Raises:
        InputError: an array of another shape, or a mask of other numbers.
    """
    _check(frame, mask=mask, joints=joints, detections=detections, confidence=confidence)
    if mask is not None and mask.dtype != np.bool_ and not float(mask.max(initial=0)) <= 1:
        raise InputError(
            f"mask is {mask.dtype} up to {float(mask.max()):g}, expected bool, or coverage from 0 "
            "to 1: compare bytes, as mask > 127"
        )
    canvas = frame.copy()
    if mask is not None:
        _draw_outline(canvas, mask.astype(np.float32), style)
    if joints is not None:
        _draw_skeleton(canvas, joints.astype(np.float64), style)
    if detections is not None:
        opacity = np.ones(LANDMARKS) if confidence is None else np.nan_to_num(confidence)
        _draw_crosses(canvas, detections.astype(np.float64), np.clip(opacity, 0, 1), style)
    return canvas


def draw_caption(frame: Image, line: str, style: OverlayStyle = OverlayStyle()) -> Image:
    """Write a line of small text (ASCII) at the upper left of a copy of a frame (H, W, 3) uint8."""
    _check(frame)
    canvas = frame.copy()
    height = style.caption_height * _scale(frame)
    left, middle = 2 * height, 2 * height
    ends = [[left, middle], [left + text_width(line, height), middle]]
    stroke(canvas, np.array([ends]), 1.1 * height, BLACK, style.halo)
    text(canvas, line, (left, middle + height / 2), height, (255, 255, 255))
    return canvas


def _draw_outline(canvas: Image, mask: NDArray[np.float32], style: OverlayStyle) -> None:
    scale = _scale(canvas)
    if style.tint:
        blend(canvas, mask * style.tint, style.outline)
    if style.outline_width:
        radius = style.outline_width * scale / 2
        seam = radius + style.halo_width * scale
        box, distance = border_distance(mask, max(seam / 3, 0.9), seam)
        blend(canvas[box], style.halo * np.clip(seam + 0.5 - distance, 0, 1), BLACK)
        blend(canvas[box], np.clip(radius + 0.5 - distance, 0, 1), style.outline)


def _draw_skeleton(canvas: Image, joints: Floats, style: OverlayStyle) -> None:
    """Sticks over one halo, then dots; a dot has the colour of its side."""
    scale = _scale(canvas)
    points = np.vstack([joints, joints[list(HIPS)].mean(0)])
    radius, dot = style.stick_width * scale / 2, style.joint_radius * scale
    halo = style.halo_width * scale
    sides = ((LEFT, style.left), (MIDDLE, style.middle), (RIGHT, style.right))
    everything = points[np.array(LEFT + MIDDLE + RIGHT)]
    stroke(canvas, everything, radius + halo, BLACK, style.halo)
    stroke(canvas, np.stack([points, points], 1), dot + halo, BLACK, style.halo)
    for sticks, color in sides:
        stroke(canvas, points[np.array(sticks)], radius, color)
    for sticks, color in sides:
        ends = points[sorted({end for _, end in sticks} | ({0} if sticks is MIDDLE else set()))]
        stroke(canvas, np.stack([ends, ends], 1), dot, color)
        stroke(canvas, np.stack([ends, ends], 1), 0.45 * dot, (255, 255, 255), 0.85)


def _draw_crosses(canvas: Image, points: Floats, opacity: Floats, style: OverlayStyle) -> None:
    scale = _scale(canvas)
    arm = style.detection_arm * scale / np.sqrt(2)
    diagonals = np.array([[[-arm, -arm], [arm, arm]], [[-arm, arm], [arm, -arm]]])
    segments = (points[:, None, None] + diagonals).reshape(-1, 2, 2)
    strength, radius = opacity.repeat(2), style.detection_width * scale / 2
    stroke(canvas, segments, radius + style.halo_width * scale, BLACK, style.halo * strength)
    stroke(canvas, segments, radius, style.detection, strength)


def _scale(frame: Image) -> float:
    """Pixels of this frame in one of a frame 720 px high; marks never get thinner than readable."""
    return max(float(min(frame.shape[:2])) / 720, 0.5)


def _check(frame: Image, **arrays: NDArray[np.generic] | None) -> None:
    if frame.ndim != 3 or frame.shape[-1] != 3 or frame.dtype != np.uint8:
        raise InputError(
            f"frame has shape {frame.shape} and dtype {frame.dtype}; expected (H, W, 3) uint8 RGB"
        )
    pair = (LANDMARKS, 2)
    expected = {"mask": frame.shape[:2], "joints": pair, "detections": pair}
    for name, array in arrays.items():
        shape = expected.get(name, (LANDMARKS,))
        if array is not None and array.shape != shape:
            raise InputError(f"{name} has shape {array.shape}; expected {shape}")
