"""One of several people as their model alone would be seen: the material of the shape prior."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.trimap import Box, Mask, bounds, signed_distance

Plane = NDArray[np.float32]
Parts = NDArray[np.int16]

_FAR = np.float32(1e6)  # px, where nobody is drawn


@dataclass(frozen=True)
class PersonLayer:
    """A posed model in an image, drawn without the others.

    Attributes:
        depth: of its nearest surface in ``box``, (h, w) m, infinite where it is not.
        part: body part that is seen there, (h, w), -1 where none is.
        box: rows and columns of the image in which the model is.
        shape: (H, W) of the image.
        spread: by how many pixels the outline of each part may be elsewhere, one deviation, (P,).
        doubt: by how many metres its depth may be, one deviation.
    """

    depth: Plane
    part: Parts
    box: Box
    shape: tuple[int, int]
    spread: Plane
    doubt: float

    @classmethod
    def of(
        cls,
        depth: Plane,
        part: NDArray[np.integer],
        spread: Plane,
        doubt: float,
        corner: tuple[int, int] = (0, 0),
        shape: tuple[int, int] | None = None,
    ) -> PersonLayer:
        """Of a part of an image (h, w) that holds the model; what is around it is left out.

        Args:
            depth: m, infinite where the model is not, (h, w).
            part: body part seen, (h, w).
            spread: of each part's outline, (P,) px.
            doubt: deviation of its depth, m.
            corner: row and column of the image at which these begin.
            shape: (H, W) of the image; that of ``depth`` if None.
        """
        shape = shape or (depth.shape[0], depth.shape[1])
        inside = np.isfinite(depth)
        box = bounds(inside, 0)
        kept = depth[box].astype(np.float32), part[box].astype(np.int16)
        rows, columns = (
            slice(side.start + first, side.stop + first)
            for side, first in zip(box, corner, strict=True)
        )
        return cls(*kept, (rows, columns), shape, np.asarray(spread, np.float32), doubt)

    @property
    def mask(self) -> Mask:
        """(H, W)."""
        whole = np.zeros(self.shape, np.bool_)
        whole[self.box] = np.isfinite(self.depth)
        return whole

    def seen_from(self, box: Box) -> Surroundings:
        """The layer in another part of the image, and continued around the model."""
        shape = box[0].stop - box[0].start, box[1].stop - box[1].start
        depth, part = np.full(shape, np.inf, np.float32), np.full(shape, -1, np.int16)
        rows, columns = (
            slice(max(one.start, other.start), max(one.start, min(one.stop, other.stop)))
            for one, other in zip(self.box, box, strict=True)
        )
        rows = slice(rows.start, max(rows.start, rows.stop))
        columns = slice(columns.start, max(columns.start, columns.stop))
        there = _within(rows, columns, box)
        own = _within(rows, columns, self.box)
        depth[there], part[there] = self.depth[own], self.part[own]
        return Surroundings.of(depth, part, self.spread)


@dataclass(frozen=True)
class Surroundings:
    """A layer in a part of the image, with what is nearest of it where it is not.

    Attributes:
        distance: px to the outline, positive inside, (h, w).
        depth: m, of the nearest pixel of the model, (h, w); infinite where there is none at all.
        part: of that pixel, (h, w).
        spread: px, of that part, (h, w).
    """

    distance: Plane
    depth: Plane
    part: Parts
    spread: Plane

    @classmethod
    def of(cls, depth: Plane, part: Parts, spread: Plane) -> Surroundings:
        """Of a depth map with the parts seen, (h, w) each, and the spread of each part."""
        inside = np.isfinite(depth)
        if not inside.any():
            one = np.ones_like(depth)
            return cls(-_FAR * one, np.inf * one, np.zeros_like(part), one)
        distance = signed_distance(inside)
        _, index = cv2.distanceTransformWithLabels(
            (~inside).astype(np.uint8),
            cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL,
        )  # fmt: skip
        # numbers of the model's pixels, in the order in which the transform counts them
        order = np.zeros(int(index.max()) + 1, np.int64)
        order[index[inside]] = np.flatnonzero(inside)
        nearest = order[index]
        near_part = part.ravel()[nearest]
        return cls(distance, depth.ravel()[nearest], near_part, spread[near_part])


def _within(rows: slice, columns: slice, box: Box) -> Box:
    """Rows and columns of an image as those of a part of it."""
    return (
        slice(rows.start - box[0].start, rows.stop - box[0].start),
        slice(columns.start - box[1].start, columns.stop - box[1].start),
    )
