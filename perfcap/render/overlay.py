"""What was captured, drawn over the frame it was captured from.

Every mark has a dark halo, so that it reads on bright and on busy frames, and its width follows
the image. The right side of the body is orange, the left side blue, the middle nearly white.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.render._marks import (
    Color,
    Floats,
    Image,
    blend,
    border_distance,
    stroke,
    text,
    text_width,
)

LANDMARKS = 16  # head_top, neck, arms, legs: the order of the detector
HIPS = (8, 12)
PELVIS = 16  # middle of the hips, appended to the landmarks
MIDDLE = ((0, 1), (1, PELVIS))
RIGHT = ((1, 2), (2, 3), (3, 4), (PELVIS, 8), (8, 9), (9, 10), (10, 11))
LEFT = ((1, 5), (5, 6), (6, 7), (PELVIS, 12), (12, 13), (13, 14), (14, 15))
BLACK = (0, 0, 0)


@dataclass(frozen=True)
class OverlayStyle:
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
        InputError: an array of another shape.
    """
    _check(frame, mask=mask, joints=joints, detections=detections, confidence=confidence)
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
