"""Planes of the background, followed from frame to frame.

What a moving camera sees of a floor and a wall moves by a homography each. Corners of one frame are
followed through others; a homography that most agree with is found first, then one for those that
do not agree, and so on (sequential RANSAC). A corner belongs to one plane throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.registration import Matrix
from perfcap.segment.trimap import Mask
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]
Points = NDArray[np.float32]

_TILES = 4  # rows, and columns, of tiles that corners are spread over
_WINDOW = (15, 15)
_PYRAMID = 4


@dataclass(frozen=True)
class LayerSettings(Settings):
    """How planes are found.

    Attributes:
        side: px, images are shrunk to this longest side.
        corners: at most.
        planes: at most.
        least: corners that make a plane.
        share: of the corners followed that make a further plane.
        kept: share of a plane's corners in view that must agree in a further frame; by chance
            some agree in any two pictures.
        tolerance: px of the shrunk image, within which corners agree.
    """

    side: int = 640
    corners: int = 400
    planes: int = 3
    least: int = 12
    share: float = 0.08
    kept: float = 0.2
    tolerance: float = 1.0


@dataclass(frozen=True)
class Corners:
    """Corners of the background of one frame.

    Attributes:
        gray: the shrunk frame, (h, w).
        points: (n, 2) px of it.
        planes: which plane each is on, (n,); -1 on none, before planes are known.
    """

    gray: Image
    points: Points
    planes: NDArray[np.int64]

    @property
    def count(self) -> int:
        """Planes."""
        return int(self.planes.max(initial=-1)) + 1


def find_corners(gray: Image, hidden: Mask, settings: LayerSettings) -> Corners:
    """Corners of a shrunk frame (h, w) where it is not ``hidden`` (h, w), spread over it."""
    open_ = (~hidden).astype(np.uint8)
    rows, columns = (np.linspace(0, side, _TILES + 1).astype(int) for side in gray.shape)
    found = []
    for top, bottom in pairwise(rows):
        for left, right in pairwise(columns):
            part = slice(top, bottom), slice(left, right)
            corners = cv2.goodFeaturesToTrack(
                gray[part], settings.corners // _TILES**2, 0.02, 6, mask=open_[part]
            )
            if corners is not None:
                found.append(corners.reshape(-1, 2) + np.array([left, top]))
    points = np.concatenate(found) if found else np.zeros((0, 2))
    none = np.full(len(points), -1)
    return Corners(gray, points.astype(np.float32), none)


def meet(corners: Corners, gray: Image, settings: LayerSettings) -> tuple[Corners, list[Matrix]]:
    """Find planes by how corners move to a frame close in time, with a homography each.

    Returns:
        The corners, with their planes, and homographies (3, 3) of shrunk pixels; none of either
        where too few agree.
    """
    moved, found = follow(corners.gray, gray, corners.points)
    planes = np.full(len(moved), -1)
    matrices: list[Matrix] = []
    for _ in range(settings.planes):
        free = found & (planes < 0)
        matrix, inside = _fit(corners.points[free], moved[free], settings)
        enough = max(settings.least, settings.share * int(found.sum()))
        if matrix is None or int(inside.sum()) < enough:
            break
        planes[np.nonzero(free)[0][inside]] = len(matrices)
        matrices.append(matrix)
    return Corners(corners.gray, corners.points, planes), matrices


def carry_on(
    corners: Corners,
    matrices: Sequence[Matrix | None],
    before: tuple[Image, Mask],
    gray: Image,
    settings: LayerSettings,
) -> list[Matrix | None]:
    """Homographies to a further frame, from those to its neighbour.

    Args:
        corners: with their planes.
        matrices: to the neighbour.
        before: the neighbour, shrunk, and where people may be in it, (h, w).
        gray: the further frame, shrunk.
        settings: of the planes.

    Returns:
        One for each plane, None where it is lost.
    """
    near = [None if m is None else apply(m, corners.points) for m in matrices]
    guesses: list[Matrix | None] = []
    for plane, places in enumerate(near):
        guess = None
        if places is not None:
            chosen = (corners.planes == plane) & _open(places, before[1])
            stepped, found = follow(before[0], gray, places[chosen])
            guess, _ = _fit(corners.points[chosen][found], stepped[found], settings)
        guesses.append(guess)
    return [
        None if guess is None else _settled(corners, plane, guess, gray, settings)
        for plane, guess in enumerate(guesses)
    ]


def _settled(
    corners: Corners, plane: int, guess: Matrix, gray: Image, settings: LayerSettings
) -> Matrix | None:
    """A guess, corrected by following the corners of the first frame all the way."""
    points = corners.points[corners.planes == plane]
    start = apply(guess, points)
    moved, found = follow(corners.gray, gray, points, start)
    near = found & (np.hypot(*(moved - start).T) < 4 * settings.tolerance)
    matrix, inside = _fit(points[near], moved[near], settings)
    enough = max(settings.least, settings.kept * int(found.sum()))
    return matrix if int(inside.sum()) >= enough else None


def apply(matrix: Matrix, points: Points) -> Points:
    """Points (n, 2) under a homography."""
    if not len(points):
        return points
    moved: Points = cv2.perspectiveTransform(points[:, None], matrix)[:, 0].astype(np.float32)
    return moved


def _fit(
    points: Points, moved: Points, settings: LayerSettings
) -> tuple[Matrix | None, NDArray[np.bool_]]:
    """A homography that as many as possible agree with, and who does."""
    nobody = np.zeros(len(points), np.bool_)
    if len(points) < settings.least:
        return None, nobody
    matrix, inside = cv2.findHomography(points, moved, cv2.RANSAC, settings.tolerance)
    if matrix is None:
        return None, nobody
    return matrix, inside.ravel() > 0


def follow(
    gray: Image, other: Image, points: Points, start: Points | None = None
) -> tuple[Points, NDArray[np.bool_]]:
    """Where points (n, 2) are in another frame, and whether they are found (n,)."""
    if not len(points):
        return points, np.zeros(0, np.bool_)
    flags = 0 if start is None else cv2.OPTFLOW_USE_INITIAL_FLOW
    guess = None if start is None else start[:, None].copy()
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        *(gray, other, points[:, None], guess),
        winSize=_WINDOW,
        maxLevel=_PYRAMID if start is None else 1,
        flags=flags,
    )
    inside = _open(moved[:, 0], np.zeros(other.shape, np.bool_))
    return moved[:, 0], (found.ravel() > 0) & inside


def _open(points: Points, hidden: Mask) -> NDArray[np.bool_]:
    """Which points (n, 2) lie in a picture where it is not hidden (h, w)."""
    height, width = hidden.shape
    at = np.rint(np.nan_to_num(points, nan=-1.0, posinf=-1.0, neginf=-1.0)).astype(np.int64)
    inside = (at >= 0).all(1) & (at[:, 0] < width) & (at[:, 1] < height)
    column, row = np.where(inside[:, None], at, 0).T
    seen: NDArray[np.bool_] = inside & ~hidden[row, column]
    return seen
