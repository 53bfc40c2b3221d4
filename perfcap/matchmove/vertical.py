"""The vertical from straight edges of what was built: corners of rooms, doors, posts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_mask, require_picture
from perfcap.matchmove._arguments import require_direction, require_lens, require_rotation
from perfcap.segment.registration import shrink
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Array = NDArray[np.float64]

_STEP, _FINER = 0.5, 0.05  # degrees between directions that are tried


@dataclass(frozen=True)
class VerticalSettings(Settings):
    """How the vertical is found.

    Attributes:
        side: px, images are shrunk to this longest side.
        shortest: edge that is looked at, of the longest side.
        within: degrees, by which edges that agree are off.
        cone: degrees about the start, in which the vertical lies.
        spread: degrees, deviation of the vertical about the start.
        support: length of edges that agree, of the longest side, in the mean of the images.
        contrast: times the support of other directions.
        apart: how much these edges lie in different planes, the length times the squared sine of
            the angle between; a single edge, or some on one line, agree with many directions.
    """

    side: int = 960
    shortest: float = 0.025
    within: float = 1.0
    cone: float = 25.0
    spread: float = 12.0
    support: float = 0.25
    contrast: float = 12.0
    apart: float = 0.01


@dataclass(frozen=True)
class Sight:
    """An image, what of it is no background, and its camera.

    Attributes:
        image: (H, W, 3).
        hidden: where people may be, (H, W).
        lens: focal length and principal point x, y, px.
        rotation: world to camera, (3, 3).
    """

    image: Image
    hidden: Mask
    lens: tuple[float, float, float]
    rotation: Array

    def __post_init__(self) -> None:
        require_picture(self.image, "image")
        require_mask(self.hidden, "hidden", self.image.shape[:2])
        require_lens(self.lens, max(self.image.shape[:2]))
        require_rotation(self.rotation)


def find_vertical(
    views: Sequence[Sight], start: Array, settings: VerticalSettings | None = None
) -> Array | None:
    """The direction in the world that most straight edges run along; up, as the start is.

    Edge and optical centre span a plane, which all that is parallel to the edge lies in; the
    vertical is the direction near the start that lies in as many of these planes as possible
    (Barnard 1983).

    Args:
        views: of one camera, at rest or of frames that are spread over its way.
        start: about up in the world, a unit vector (3,).
        settings: of the search.

    Returns:
        A unit vector (3,); None where too few edges agree, or many directions are as good.

    Raises:
        InputError: the start is no unit vector.
    """
    require_direction(start)
    settings = settings or VerticalSettings()
    found = [_planes(view, settings) for view in views]
    if not any(len(planes) for planes, _ in found):
        return None
    normals = np.concatenate([planes for planes, _ in found])
    lengths = np.concatenate([length for _, length in found]) / len(found)
    tried = _around(start, settings.cone, _STEP)
    support = _support(tried, normals, lengths, settings)
    apart = np.degrees(np.arccos((tried @ start).clip(-1, 1)))
    chosen = int((support * np.exp(-0.5 * (apart / settings.spread) ** 2)).argmax())
    best = float(support[chosen])
    # about the direction itself: what is usual about the start depends on where that happens to be
    others = _support(_around(tried[chosen], settings.cone, 2 * _STEP), normals, lengths, settings)
    if best < settings.support or best < settings.contrast * float(np.median(others)):
        return None
    near = _around(tried[chosen], 2 * _STEP, _FINER)
    up: Array = near[int(_support(near, normals, lengths, settings).argmax())]
    agreeing = _agreement(up[None], normals, settings)[0] * lengths
    across = np.linalg.eigvalsh((normals * agreeing[:, None]).T @ normals)[1]
    return up if across > settings.apart else None


def _planes(view: Sight, settings: VerticalSettings) -> tuple[Array, Array]:
    """Normals (n, 3) in the world of planes through edges, and lengths of these, (n,)."""
    longest = max(view.image.shape[:2])
    scale = min(1.0, settings.side / longest)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(shrink(view.image, scale))[0]
    if found is None:
        return np.zeros((0, 3)), np.zeros(0)
    ends = (found.reshape(-1, 2, 2).astype(np.float64) + 0.5) / scale - 0.5
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1) / longest
    middle = np.rint(ends.mean(1)).astype(np.int64)
    height, width = view.hidden.shape
    column, row = middle[:, 0].clip(0, width - 1), middle[:, 1].clip(0, height - 1)
    good = (lengths > settings.shortest) & ~view.hidden[row, column]
    plane = (ends[good] - view.lens[1:]) / view.lens[0]
    rays = np.concatenate((plane, np.ones((*plane.shape[:2], 1))), -1)
    normals = np.cross(rays[:, 0], rays[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals @ view.rotation, lengths[good]


def _around(direction: Array, cone: float, step: float) -> Array:
    """Unit vectors (n, 3) about one, out to so many degrees."""
    axis = np.eye(3)[int(np.abs(direction).argmin())]
    right = np.cross(direction, axis)
    right /= np.linalg.norm(right)
    ahead = np.cross(direction, right)
    angles = np.radians(np.arange(-cone, cone + step / 2, step))
    across, along = np.meshgrid(angles, angles)
    apart = np.hypot(across, along)
    share = np.divide(np.sin(apart), apart, out=np.ones_like(apart), where=apart > 0)
    tried = (
        np.cos(apart)[..., None] * direction
        + (share * across)[..., None] * right
        + (share * along)[..., None] * ahead
    )
    near: Array = tried[apart <= math.radians(cone) + 1e-9]
    return near


def _support(tried: Array, normals: Array, lengths: Array, settings: VerticalSettings) -> Array:
    """Length of the edges that run along each direction (n, 3), (n,)."""
    found: Array = _agreement(tried, normals, settings) @ lengths
    return found


def _agreement(tried: Array, normals: Array, settings: VerticalSettings) -> Array:
    """How well each direction (n, 3) lies in each plane (m, 3), 0 to 1, (n, m)."""
    off = np.degrees(np.arcsin(np.abs(tried @ normals.T).clip(max=1)))
    agreement: Array = 1 / np.square(1 + np.square(off / settings.within))
    return agreement
