"""How well a posed mesh and a silhouette explain each other, for many poses at once.

Liu et al. 2013, Eq. 7 and 8: silhouette that no part of the mesh covers costs alike wherever it is,
mesh beyond the silhouette costs its distance to it. No derivative is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_indices, require_shape
from perfcap.segment import _silhouette_consistency_numba as kernel

MISSED = 80.0  # lambda: cost of a silhouette of which nothing is covered, in units of distance

Floats = NDArray[np.float64]
Places = NDArray[np.floating]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class CoarseSilhouette:
    """A person's silhouette in one view, at as many pixels as the search needs.

    Attributes:
        inside: (h, w).
        distance: to the silhouette, (h, w), in the unit of the energy.
        corner: column and row of the image where it begins, px.
        scale: pixels of the image in one of its own.
    """

    inside: Flags
    distance: NDArray[np.float32]
    corner: tuple[int, int]
    scale: float

    def __post_init__(self) -> None:
        require_shape(self.distance, "distance", self.inside.shape, "(h, w) of the silhouette")

    @classmethod
    def of(cls, mask: Flags, part: tuple[slice, slice], scale: float, unit: float) -> Self:
        """Of a mask (H, W).

        Args:
            mask: where the person is.
            part: rows and columns that are looked at; what a pose covers beyond costs nothing.
            scale: pixels of the image in one of the result, 1 or more.
            unit: pixels of the image that count as one.
        """
        crop = mask[part].astype(np.float32)
        size = [max(1, round(side / scale)) for side in crop.shape]
        inside = cv2.resize(crop, size[::-1], interpolation=cv2.INTER_AREA) >= 0.5
        if inside.any():
            outside = (~inside).astype(np.uint8)
            distance = cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        else:  # as far as anything is
            distance = np.full(size, np.hypot(*size), np.float32)
        corner = part[1].start, part[0].start
        return cls(inside, (distance * scale / unit).astype(np.float32), corner, scale)

    def on_grid(self, pixels: Places) -> tuple[Places, Places]:
        """Columns and rows of places (2, ...) px of the image in pixels of the silhouette."""
        # corners of images are half a pixel before the first centre
        x, y = (
            (axis - (first - 0.5)) / self.scale - 0.5
            for axis, first in zip(pixels, self.corner, strict=True)
        )
        return x, y


@dataclass(frozen=True, eq=False)
class Coverage:
    """What the parts of a mesh that no pose of a search moves cover of a silhouette.

    Attributes:
        silhouette: of the person.
        picture: bits of covered pixels, (h, w).
        sums: see ``_silhouette_consistency_numba.cover``, (3,).
    """

    silhouette: CoarseSilhouette
    picture: NDArray[np.uint8]
    sums: Floats

    def __post_init__(self) -> None:
        own = self.silhouette.inside.shape
        require_shape(self.picture, "picture", own, "(h, w) of the silhouette")

    @classmethod
    def of(
        cls,
        silhouette: CoarseSilhouette,
        pixels: Places,
        usable: Flags,
        faces: NDArray[np.int64],
        seen: Flags,
    ) -> Self:
        """Of triangles ``faces`` (T, 3).

        Args:
            silhouette: of the person.
            pixels: columns and rows of the vertices in the image, (2, V) px.
            usable: False for those behind the camera, (V,).
            faces: that stay where they are.
            seen: whether each triangle's part was seen in the frame before, (T,): what somebody
                hides costs nothing beyond the silhouette.

        Raises:
            InputError: arrays that do not fit each other.
        """
        _require_fitting(pixels, usable, faces, seen, (2, None))
        picture, sums = np.zeros(silhouette.inside.shape, np.uint8), np.zeros(3)
        where = *silhouette.on_grid(pixels), usable
        kernel.cover(*where, faces, seen, silhouette.inside, silhouette.distance, picture, sums)
        return cls(silhouette, picture, sums)

    def costs(
        self,
        pixels: Places,
        usable: Flags,
        faces: NDArray[np.int64],
        seen: Flags,
        missed: float = MISSED,
    ) -> Floats:
        """``sum_i d_i`` of Eq. 8, (N,), of N poses of the other triangles.

        Args:
            pixels: columns and rows of the vertices in the image, (2, N, V) px.
            usable: (N, V).
            faces: that the poses move, (T, 3).
            seen: (T,).
            missed: cost of a silhouette of which nothing is covered.

        Raises:
            InputError: arrays that do not fit each other.
        """
        _require_fitting(pixels, usable, faces, seen, (2, None, None))
        own = self.silhouette
        where = *own.on_grid(pixels), usable
        covered, beyond, area = kernel.cover_each(
            *where, faces, seen, own.inside, own.distance, self.picture, self.sums
        ).T
        whole = max(int(own.inside.sum()), 1)
        explained = missed * (own.inside.sum() - covered) / whole
        found: Floats = explained + beyond / np.maximum(area, 1)
        return found


def _require_fitting(
    pixels: Places,
    usable: Flags,
    faces: NDArray[np.int64],
    seen: Flags,
    shape: tuple[int | None, ...],
) -> None:
    require_shape(pixels, "pixels", shape, "columns and rows of the vertices")
    require_shape(usable, "usable", pixels.shape[1:], "whether each vertex is")
    require_shape(faces, "faces", (None, 3), "(T, 3)")
    require_shape(seen, "seen", faces.shape[:1], "(T,), whether each triangle was")
    require_indices(faces, "faces", pixels.shape[-1], "vertices")
