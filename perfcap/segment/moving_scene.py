"""The background of a camera that moves, from all of a stretch.

Samples of the stretch are brought to where one frame's camera is: each plane of the background by
its own homography, then by the small shifts that parallax leaves. There they make a plate, as those
of a camera that stands still do; it serves the frames around.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment import _planes_numba
from perfcap.segment.alignment import AlignmentSettings, fill, find_shifts, match_exposure
from perfcap.segment.background import Plate, PlateSettings, build_plate
from perfcap.segment.plane_layers import (
    Corners,
    LayerSettings,
    carry_on,
    find_corners,
    meet,
)
from perfcap.segment.registration import Matrix, shrink
from perfcap.segment.trimap import Box, Mask
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]
Planes = NDArray[np.uint8]

_THUMBNAIL = (32, 32)
_TRIES = (0, -1, 1, -2, 2, -4, 4)  # samples from the most alike one, to find planes with
_MISSED = 2  # samples in a row that may not fit
_OUTSIDE = 40.0  # grey levels: more is as bad
_SMOOTH = (0.02, 0.06, 0.2)  # shares of the longest side, over which planes are told apart


@dataclass(frozen=True)
class MovingSettings(Settings):
    """How the background of a moving camera is found."""

    layers: LayerSettings = field(default_factory=LayerSettings)
    alignment: AlignmentSettings = field(default_factory=AlignmentSettings)


@dataclass(frozen=True)
class View:
    """A frame, and the same shrunk.

    Attributes:
        image: (H, W, 3) RGB.
        hidden: where people may be, (H, W).
        gray: shrunk, (h, w).
        closed: ``hidden``, shrunk, (h, w).
        scale: shrunk pixels a pixel.
    """

    image: Image
    hidden: Mask
    gray: Image
    closed: Mask
    scale: float

    @classmethod
    def of(cls, image: Image, hidden: Mask, side: int) -> View:
        """Shrink a frame to a longest side."""
        scale = min(1.0, side / max(image.shape[:2]))
        gray = shrink(image, scale)
        size = gray.shape[::-1]
        closed = cv2.resize(hidden.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        return cls(image, hidden, gray, closed, scale)


@dataclass(frozen=True)
class Samples:
    """Frames of a stretch, in the order of time."""

    views: tuple[View, ...]
    settings: MovingSettings = field(default_factory=MovingSettings)

    @classmethod
    def of(
        cls, images: Sequence[Image], hidden: Sequence[Mask], settings: MovingSettings | None = None
    ) -> Samples:
        """Of images (H, W, 3) and where people may be in them (H, W)."""
        settings = settings or MovingSettings()
        pairs = zip(images, hidden, strict=True)
        return cls(tuple(View.of(*pair, settings.layers.side) for pair in pairs), settings)

    def key_frame(
        self, image: Image, hidden: Mask, region: Box, settings: PlateSettings
    ) -> KeyFrame | None:
        """The background as the camera of a frame (H, W, 3) sees it.

        Args:
            image: of the same shot.
            hidden: where people may be in it, (H, W).
            region: the part wanted.
            settings: how plates are made.

        Returns:
            The frame with its plate; None where no sample fits it.
        """
        key = View.of(image, hidden, self.settings.layers.side)
        corners = find_corners(key.gray, key.closed, self.settings.layers)
        corners, places = self._places(corners, key)
        if not places:
            return None
        planes = _tell_apart(key, [(self.views[index], m) for index, m in places], corners.count)
        coordinates = (
            (self.views[index], _coordinates(m, planes, key.scale, region)) for index, m in places
        )
        brought = [self._bring(key, region, *place) for place in coordinates]
        shown, closed = (list(part) for part in zip(*brought, strict=True))
        return KeyFrame(key, region, build_plate(shown, closed, settings), self.settings)

    def _bring(self, key: View, region: Box, sample: View, at: Plane) -> tuple[Image, Mask]:
        """A sample as a frame's camera would have seen it, and where it shows nothing."""
        target = key.image[region]
        picture, closed = _remap(sample.image, at), _remap(sample.hidden.astype(np.uint8), at, 1)
        visible = (closed == 0) & ~key.hidden[region]
        picture = match_exposure(target, picture, visible)
        shifts = find_shifts(target, picture, visible, self.settings.alignment)
        if shifts is not None:
            bent = _grid(target.shape) + shifts
            picture, closed = _remap(picture, bent), _remap(closed, bent, 1)
        return picture, closed > 0

    def _places(
        self, corners: Corners, key: View
    ) -> tuple[Corners, list[tuple[int, list[Matrix | None]]]]:
        """Samples that fit a frame, and homographies of each plane from the frame to them."""
        met, first, matrices = self._meet(corners, key)
        if not matrices:
            return met, []
        known: list[Matrix | None] = [*matrices]
        places = [(first, known)]
        for step in (1, -1):
            places += self._outwards(met, first, known, step)
        return met, places

    def _meet(self, corners: Corners, key: View) -> tuple[Corners, int, list[Matrix]]:
        """Planes, from the sample that shows most of them: a frame too near shows no parallax."""
        alike = self._most_alike(key.image)
        tries = [alike + step for step in _TRIES if 0 <= alike + step < len(self.views)]
        found = [
            (*meet(corners, self.views[index].gray, self.settings.layers), index) for index in tries
        ]
        met, matrices, index = max(found, key=lambda f: (len(f[1]), int((f[0].planes >= 0).sum())))
        return met, index, matrices

    def _outwards(
        self, corners: Corners, index: int, matrices: list[Matrix | None], step: int
    ) -> Iterator[tuple[int, list[Matrix | None]]]:
        """Samples before or after one whose homographies are known, each from its neighbour.

        A few in a row that do not fit are passed over: a flash, a frame that was lost.
        """
        before, missed = self.views[index], 0
        while 0 <= index + step < len(self.views) and missed <= _MISSED:
            index += step
            after = self.views[index]
            found = carry_on(
                corners, matrices, (before.gray, before.closed), after.gray, self.settings.layers
            )
            missed += 1
            if any(matrix is not None for matrix in found):
                before, matrices, missed = after, found, 0
                yield index, found

    def _most_alike(self, image: Image) -> int:
        """The sample whose thumbnail differs least."""
        small = _thumbnail(image)
        return int(
            np.argmin([np.abs(_thumbnail(view.image) - small).mean() for view in self.views])
        )


@dataclass(frozen=True)
class KeyFrame:
    """A frame with a plate, for the frames around it.

    Attributes:
        view: the frame.
        region: the part of it that the plate is of.
        plate: (h, w) of the region.
        settings: of what it was made with.
    """

    view: View
    region: Box
    plate: Plate
    settings: MovingSettings

    def seen_from(self, image: Image, hidden: Mask, box: Box) -> Plate | None:
        """The plate in the box of another frame (H, W, 3); None where that does not fit."""
        layers = self.settings.layers
        frame = View.of(image, hidden, layers.side)
        corners, matrices = meet(
            find_corners(frame.gray, frame.closed, layers), self.view.gray, layers
        )
        if not matrices:
            return None
        planes = _tell_apart(frame, [(self.view, matrices)], corners.count)
        corner = np.array([self.region[1].start, self.region[0].start], np.float32)
        at = _coordinates(matrices, planes, frame.scale, box) - corner
        color, known = _remap(self.plate.color, at), self._known(at)
        visible = known & ~hidden[box]
        matched = match_exposure(image[box], color, visible)
        shifts = find_shifts(image[box], matched, visible, self.settings.alignment)
        if shifts is not None:  # the map of the whole, bent: everything is interpolated once
            at = _remap(at, _grid(at.shape) + shifts)
            color, known = _remap(self.plate.color, at), self._known(at)
        return Plate(color, _remap(self.plate.deviation, at), known)

    def _known(self, at: Plane) -> Mask:
        unknown: Mask = _remap((~self.plate.known).astype(np.uint8), at, 1) > 0
        return ~unknown


def _tell_apart(
    key: View, samples: Sequence[tuple[View, Sequence[Matrix | None]]], count: int
) -> Planes:
    """Which plane each pixel of a frame is on, (h, w) of the shrunk frame.

    The one by which the frame and its samples agree best: behind people the samples alone.
    """
    shape = key.gray.shape
    if count < 2:
        return np.zeros(shape, np.uint8)
    costs = [
        _disagreement(key, [(view, m[plane]) for view, m in samples]) for plane in range(count)
    ]
    cost, weight = (np.stack(part, -1) for part in zip(*costs, strict=True))
    certain = weight.min(-1)
    smooth = fill(cost, certain, [share * max(shape) for share in _SMOOTH])
    nearest: Planes = np.argmin(smooth, -1).astype(np.uint8)
    return nearest


def _disagreement(key: View, samples: Sequence[tuple[View, Matrix | None]]) -> tuple[Plane, Plane]:
    """Mean difference of pictures from their mean if all were on one plane, grey levels, (h, w).

    And whether two pictures or more show a pixel, 0 or 1.
    """
    shape = key.gray.shape
    pictures = [key.gray.astype(np.float32)]
    seen = [~key.closed]
    flat, whole = np.zeros(shape, np.uint8), (slice(0, shape[0]), slice(0, shape[1]))
    for sample, matrix in samples:
        at = _coordinates([matrix], flat, 1.0, whole)
        pictures.append(_remap(sample.gray, at).astype(np.float32))
        seen.append(_remap(sample.closed.astype(np.uint8), at, 1) == 0)
    shown, weights = np.stack(pictures), np.stack(seen).astype(np.float32)
    total = weights.sum(0)
    mean = (shown * weights).sum(0) / np.maximum(total, 1)
    apart = (np.abs(shown - mean) * weights).sum(0) / np.maximum(total, 1)
    compared = total >= 2
    cost: Plane = np.where(compared, np.minimum(apart, _OUTSIDE), 0).astype(np.float32)
    return cost, compared.astype(np.float32)


def _coordinates(
    matrices: Sequence[Matrix | None], planes: Planes, scale: float, box: Box
) -> Plane:
    """Where each pixel of a box is in another frame, (h, w, 2); far outside where unknown.

    Args:
        matrices: homography of each plane, of shrunk pixels.
        planes: of each shrunk pixel, (h', w').
        scale: shrunk pixels a pixel.
        box: of the whole image.
    """
    known = np.array([matrix is not None for matrix in matrices])
    values = np.stack([np.eye(3) if matrix is None else matrix for matrix in matrices])
    corner = box[0].start, box[1].start
    at = np.empty((box[0].stop - corner[0], box[1].stop - corner[1], 2), np.float32)
    _planes_numba.coordinates(values, known, planes, scale, corner, at)
    return at


def _grid(shape: tuple[int, ...]) -> Plane:
    """Column and row of each pixel, (h, w, 2)."""
    rows, columns = np.indices(shape[:2], np.float32)
    return np.stack((columns, rows), -1)


def _remap(picture, at: Plane, outside: int | None = None):  # type: ignore[no-untyped-def]
    """A picture looked at where ``at`` (h, w, 2) says; beyond it, its border, or a number."""
    border = cv2.BORDER_REPLICATE if outside is None else cv2.BORDER_CONSTANT
    return cv2.remap(
        picture, at, None, cv2.INTER_LINEAR, borderMode=border, borderValue=outside or 0
    )


def _thumbnail(image: Image) -> Plane:
    small = cv2.resize(image, _THUMBNAIL, interpolation=cv2.INTER_AREA).astype(np.float32)
    level: Plane = small - small.mean((0, 1))
    return level
