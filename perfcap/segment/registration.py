"""How the picture of the background moves when the camera does.

Between frames that are close in time a homography describes it: exactly when the camera only
turns, or sees a plane, and nearly otherwise. What remains is measured by those who use it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.trimap import Box, Mask
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]
Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class RegistrationSettings(Settings):
    """How frames are registered.

    Attributes:
        side: px, images are shrunk to this longest side to look for corners.
        corners: at most.
        least: corners that must agree.
        tolerance: px of the shrunk image, within which they agree.
    """

    side: int = 640
    corners: int = 250
    least: int = 20
    tolerance: float = 1.0


@dataclass(frozen=True)
class Landmarks:
    """Corners of the background of one frame.

    Attributes:
        gray: the shrunk frame.
        corners: (n, 1, 2) float32 px of it.
        scale: shrunk pixels a pixel.
    """

    gray: Image
    corners: Plane
    scale: float


def find_landmarks(image: Image, hidden: Mask, settings: RegistrationSettings) -> Landmarks:
    """Corners of a frame (H, W, 3) where it is not ``hidden`` (H, W)."""
    scale = min(1.0, settings.side / max(image.shape[:2]))
    gray = shrink(image, scale)
    open_ = cv2.resize(
        (~hidden).astype(np.uint8), gray.shape[::-1], interpolation=cv2.INTER_NEAREST
    )
    corners = cv2.goodFeaturesToTrack(gray, settings.corners, 0.01, 8, mask=open_)
    if corners is None:
        corners = np.zeros((0, 1, 2))
    return Landmarks(gray, corners.reshape(-1, 1, 2).astype(np.float32), scale)


def shrink(image: Image, scale: float) -> Image:
    """Grey picture of a frame, smaller."""
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(gray, np.uint8)


def register(landmarks: Landmarks, other: Image, settings: RegistrationSettings) -> Matrix | None:
    """Homography (3, 3) from pixels of the landmarks' frame to those of another (H, W, 3).

    None where too few corners agree on one.
    """
    if len(landmarks.corners) < settings.least:
        return None
    target = shrink(other, landmarks.scale)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        landmarks.gray, target, landmarks.corners, None, winSize=(15, 15), maxLevel=4
    )
    ok = found.ravel() > 0
    if int(ok.sum()) < settings.least:
        return None
    matrix, inliers = cv2.findHomography(
        landmarks.corners[ok], moved[ok], cv2.RANSAC, settings.tolerance
    )
    if matrix is None or int(inliers.sum()) < max(settings.least, ok.sum() // 3):
        return None
    # pixel centres are integers: shrinking maps x to scale (x + 1/2) - 1/2
    half = 0.5 * (landmarks.scale - 1)
    resize = np.array([[landmarks.scale, 0, half], [0, landmarks.scale, half], [0, 0, 1]])
    full: Matrix = np.linalg.inv(resize) @ matrix @ resize
    full /= full[2, 2]
    return full


def resample(image: Image, matrix: Matrix, box: Box) -> tuple[Image, Mask]:
    """Another frame seen from a frame's view: the part in ``box``, and where there is a picture.

    Args:
        image: the other frame, (H, W, 3).
        matrix: (3, 3) from the frame's pixels to the other's.
        box: part of the frame.
    """
    shift = np.array([[1, 0, box[1].start], [0, 1, box[0].start], [0, 0, 1]], float)
    size = (box[1].stop - box[1].start, box[0].stop - box[0].start)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    part = cv2.warpPerspective(image, matrix @ shift, size, flags=flags)
    inside = cv2.warpPerspective(
        np.ones(image.shape[:2], np.uint8), matrix @ shift, size, flags=cv2.WARP_INVERSE_MAP
    )
    return np.asarray(part, np.uint8), inside > 0
