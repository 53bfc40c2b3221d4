"""Corners of the background, followed from frame to frame for as long as they are seen."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_mask, require_picture
from perfcap.segment.plane_layers import LayerSettings, find_corners, follow
from perfcap.segment.registration import shrink
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Whole = NDArray[np.int64]
Array = NDArray[np.float64]


_SHOWN = 0.1  # of a frame, beside people; what is left of less may have gone out of the picture
_MANY, _GONE = 20, 0.2  # corners of a frame, and share of them that the next shows, of a cut


@dataclass(frozen=True)
class TrackSettings(Settings):
    """How corners are followed.

    Attributes:
        side: px, images are shrunk to this longest side.
        corners: at most in a frame.
        kept: share of them below which new ones are looked for.
        apart: px of the shrunk image between a new corner and those that are followed.
        returned: px of the shrunk image, within which a corner that is followed back comes home.
    """

    side: int = 640
    corners: int = 200
    kept: float = 0.8
    apart: int = 8
    returned: float = 0.5


@dataclass(frozen=True)
class Sightings:
    """Where points that stand still are seen, one row a sighting.

    Attributes:
        frame: of the clip, (N,).
        point: which one it is, (N,).
        pixels: of the shrunk images, (N, 2).
        scale: shrunk pixels a pixel.
    """

    frame: Whole
    point: Whole
    pixels: Array
    scale: float

    def __len__(self) -> int:
        return len(self.frame)

    def part(self, chosen: Mask) -> Sightings:
        """The rows that are True."""
        return Sightings(self.frame[chosen], self.point[chosen], self.pixels[chosen], self.scale)


class CornerTracks:
    """Corners of the frames of one shot, which are given one after the other."""

    def __init__(self, settings: TrackSettings | None = None) -> None:
        self._settings = settings or TrackSettings()
        self._gray: Image | None = None
        self._size: tuple[int, ...] | None = None
        self._scale = 1.0
        self._points = np.zeros((0, 2), np.float32)
        self._numbers = np.zeros(0, np.int64)
        self._count = self._frames = 0
        self._rows: list[tuple[Whole, Whole, Array]] = []
        self._cuts: list[int] = []
        self._shown = 0.0

    def add(self, image: Image, hidden: Mask) -> None:
        """Follow corners into the next frame.

        Args:
            image: (H, W, 3), of the size of those before.
            hidden: where people may be, (H, W).

        Raises:
            InputError: the image is no RGB one in bytes, or of another size than those before, or
                hidden is no mask of it.
        """
        require_picture(image, "image", self._size)
        self._size = image.shape[:2]
        require_mask(hidden, "hidden", self._size)
        self._scale = min(1.0, self._settings.side / max(image.shape[:2]))
        gray = shrink(image, self._scale)
        size = gray.shape[::-1]
        closed = cv2.resize(hidden.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        other = self._gray is not None and self._carry(gray, closed)
        if len(self._points) < self._settings.kept * self._settings.corners:
            self._look(gray, closed)
        shown = float(1 - closed.mean())
        if other and len(self._points) >= _MANY and min(shown, self._shown) >= _SHOWN:
            self._cuts.append(self._frames)
        self._shown = shown
        frame = np.full(len(self._numbers), self._frames)
        self._rows.append((frame, self._numbers, self._points.astype(np.float64)))
        self._gray, self._frames = gray, self._frames + 1

    def sightings(self) -> Sightings:
        """Everything that was seen so far."""
        if not self._rows:
            none = np.zeros(0, np.int64)
            return Sightings(none, none, np.zeros((0, 2)), self._scale)
        frame, point, pixels = (np.concatenate(part) for part in zip(*self._rows, strict=True))
        return Sightings(frame, point, pixels, self._scale)

    def cuts(self) -> tuple[int, ...]:
        """Frames that show many corners, but hardly any of those of the frame before."""
        return tuple(self._cuts)

    def _carry(self, gray: Image, closed: Mask) -> bool:
        """Where the corners are now; those that do not find back are lost.

        Returns:
            Whether that is nearly all of many.
        """
        assert self._gray is not None
        moved, found = follow(self._gray, gray, self._points)
        back, again = follow(gray, self._gray, moved)
        home = np.hypot(*(back - self._points).T) < self._settings.returned
        ok = found & again & home
        other = len(ok) >= _MANY and float(ok.mean()) < _GONE
        at = np.rint(moved[ok]).astype(np.int64)
        ok[ok] = ~closed[at[:, 1], at[:, 0]]
        self._points, self._numbers = moved[ok], self._numbers[ok]
        return other

    def _look(self, gray: Image, closed: Mask) -> None:
        """New corners, away from those that are followed."""
        taken = closed.astype(np.uint8)
        for x, y in np.rint(self._points).astype(int).tolist():
            cv2.circle(taken, (x, y), self._settings.apart, 1, -1)
        found = find_corners(gray, taken > 0, LayerSettings(corners=self._settings.corners))
        fresh = found.points[: self._settings.corners]
        self._points = np.concatenate((self._points, fresh))
        numbers = np.arange(self._count, self._count + len(fresh))
        self._numbers = np.concatenate((self._numbers, numbers))
        self._count += len(fresh)
