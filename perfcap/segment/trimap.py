"""Four regions of an image from the posed model (Xu 2018, Sec. 5.1, Eq. 9).

Pixel labels are those of GrabCut, the numbers of OpenCV's ``GC_`` constants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.setting_checks import Settings

BACKGROUND, FOREGROUND, PROBABLE_BACKGROUND, PROBABLE_FOREGROUND = 0, 1, 2, 3

Labels = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Box = tuple[slice, slice]

_HEEL, _TOES = 0.5, 0.3  # of the line from ankle to toes, by which a foot is longer at both ends
_SHIFT = 4  # fractional bits of line ends
_FAR = 1 << 14  # px, further ends are cut off: lines of 2^31 sub-pixels overflow


@dataclass(frozen=True)
class TrimapSettings(Settings):
    """Widths of the regions as shares of the person's size, the longest side of the box.

    Attributes:
        outer: how far outside the model the person may be.
        inner: how deep inside the model there may still be background.
        skeleton: the skeleton is surely foreground where it lies at least this deep inside the
            model. Near the edge, or outside, a limb may simply be in the wrong place; None
            believes it everywhere, as the paper does.
        margin: of sure background that is kept around, to learn its colours from.
        contact: how far around the line of a foot the ground may lie in its shade; 0: nowhere.
        limit: no width is more than this many pixels.
    """

    outer: float = 0.10
    inner: float = 0.04
    skeleton: float | None = 0.01
    margin: float = 0.05
    contact: float = 0.06
    limit: float = 120.0


PLAIN_TRIMAP = TrimapSettings(outer=0.05, inner=0.03, skeleton=None, contact=0.0)
"""Eq. 9 to the letter; the paper gives no widths."""


@dataclass(frozen=True)
class Trimap:
    """The regions around one person in one image.

    Attributes:
        labels: (h, w), of the part of the image inside ``box``; beyond is background.
        distance: (h, w) float32 px to the model's outline, positive inside it.
        box: rows and columns of the part.
        shape: (H, W) of the image.
        size: of the person, px; 0 if nobody is in the image.
        outer: width of the uncertain band outside the model, px.
        inner: and inside it, px.
        contact: (h, w), around the model's feet, where they may shade the ground; None: nowhere.
        people: of several people, the regions around each, in the same box; empty of one.
    """

    labels: Labels
    distance: NDArray[np.float32]
    box: Box
    shape: tuple[int, int]
    size: float
    outer: float
    inner: float
    contact: Mask | None = None
    people: tuple[Trimap, ...] = ()

    @property
    def band(self) -> Mask:
        """(h, w), where the label is open."""
        uncertain: Mask = self.labels >= PROBABLE_BACKGROUND
        return uncertain

    @property
    def model(self) -> Mask:
        """(h, w), foreground as far as the model goes."""
        inside: Mask = (self.labels == FOREGROUND) | (self.labels == PROBABLE_FOREGROUND)
        return inside

    @property
    def cropped(self) -> bool:
        """Whether the model reaches the image's border, so that there may be more of it beyond."""
        rows, columns = self.box
        inside = self.distance > 0
        sides = (
            inside[:1] if rows.start == 0 else None,
            inside[-1:] if rows.stop == self.shape[0] else None,
            inside[:, :1] if columns.start == 0 else None,
            inside[:, -1:] if columns.stop == self.shape[1] else None,
        )
        return any(side is not None and bool(side.any()) for side in sides)

    def resize(self, scale: float) -> Trimap:
        """The same regions of an image shrunk by ``scale``; sizes are in its pixels."""
        height, width = (max(1, round(side * scale)) for side in self.labels.shape)
        outer, inner = self.outer * scale, self.inner * scale
        distance = cv2.resize(self.distance, (width, height), interpolation=cv2.INTER_LINEAR)
        distance *= np.float32(scale)
        labels = _regions(distance, outer, inner)
        bones = np.argwhere((self.labels == FOREGROUND) & (self.distance <= self.inner))
        rows, columns = (bones * scale).astype(np.int64).T
        labels[np.minimum(rows, height - 1), np.minimum(columns, width - 1)] = FOREGROUND
        contact = self.contact
        if contact is not None:
            near = cv2.resize(contact.view(np.uint8), (width, height), interpolation=cv2.INTER_AREA)
            contact = near > 0
        size = self.size * scale
        return Trimap(labels, distance, self.box, self.shape, size, outer, inner, contact)

    def full(self) -> Labels:
        """Labels of the whole image, (H, W)."""
        labels = np.full(self.shape, BACKGROUND, np.uint8)
        labels[self.box] = self.labels
        return labels


def build_trimap(
    model: Mask,
    bones: NDArray[np.floating],
    settings: TrimapSettings | None = None,
    box: Box | None = None,
    feet: Sequence[int] = (),
) -> Trimap:
    """Split an image into sure and probable foreground and background.

    The image's border is not an edge of the model: what touches it continues beyond.

    Args:
        model: the posed model's silhouette, (H, W); may be empty, then all is background.
        bones: line segments of its skeleton, (B, 2, 2) px; not finite ones are left out.
        settings: widths.
        box: the part of the image to split; what the model and its surroundings need if None.
        feet: which of the bones lead from an ankle to the toes.

    Raises:
        InputError: arrays of other shapes.
    """
    settings = settings or TrimapSettings()
    _check(model, bones)
    shape = (model.shape[0], model.shape[1])
    size, needed = extent(model, settings)
    box = box or needed
    if not size:
        return _empty(box, shape)
    outer, inner = (min(share * size, settings.limit) for share in (settings.outer, settings.inner))
    distance = signed_distance(model[box])
    labels = _regions(distance, outer, inner)
    depth = -np.inf if settings.skeleton is None else min(settings.skeleton * size, settings.limit)
    corner = np.array([box[1].start, box[0].start])
    labels[draw_bones(bones - corner, labels.shape) & (distance > depth)] = FOREGROUND
    contact = _around_feet(bones[list(feet)] - corner, distance, settings.contact * size)
    return Trimap(labels, distance, box, shape, size, outer, inner, contact)


def _around_feet(
    feet: NDArray[np.floating], distance: NDArray[np.float32], reach: float
) -> Mask | None:
    """Pixels (h, w) outside the model within ``reach`` px of feet (n, 2, 2) px; None without."""
    ankles, toes = feet[:, :1], feet[:, 1:]
    ends = np.concatenate((ankles - _HEEL * (toes - ankles), toes + _TOES * (toes - ankles)), 1)
    lines = draw_bones(ends, distance.shape)
    if not reach or not lines.any():
        return None
    near: Mask = np.zeros_like(lines)
    part = bounds(lines, int(np.ceil(reach)) + 1)
    away = cv2.distanceTransform((~lines[part]).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    near[part] = (away <= reach) & (distance[part] <= 0)
    return near


def extent(model: Mask, settings: TrimapSettings) -> tuple[float, Box]:
    """Size of a model (H, W) in px, and the box that it and its surroundings need."""
    rows, columns = np.nonzero(model.any(1))[0], np.nonzero(model.any(0))[0]
    if not len(rows):
        return 0.0, (slice(0, 0), slice(0, 0))
    size = float(max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1)
    outer, margin = (
        min(share * size, settings.limit) for share in (settings.outer, settings.margin)
    )
    pad = int(np.ceil(outer + margin)) + 1
    return size, (
        slice(max(int(rows[0]) - pad, 0), min(int(rows[-1]) + pad + 1, model.shape[0])),
        slice(max(int(columns[0]) - pad, 0), min(int(columns[-1]) + pad + 1, model.shape[1])),
    )


def bounds(chosen: Mask, margin: int) -> Box:
    """The part of a mask (H, W) that holds all of it and some pixels more; empty if it is."""
    rows, columns = np.flatnonzero(chosen.any(1)), np.flatnonzero(chosen.any(0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    return (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin + 1),
        slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin + 1),
    )


def _empty(box: Box, shape: tuple[int, int]) -> Trimap:
    """Background alone."""
    part = box[0].stop - box[0].start, box[1].stop - box[1].start
    far = np.full(part, -np.inf, np.float32)
    return Trimap(np.full(part, BACKGROUND, np.uint8), far, box, shape, 0.0, 0.0, 0.0)


def _regions(distance: NDArray[np.float32], outer: float, inner: float) -> Labels:
    labels = np.where(distance > 0, PROBABLE_FOREGROUND, PROBABLE_BACKGROUND).astype(np.uint8)
    labels[distance < -outer] = BACKGROUND
    labels[distance > inner] = FOREGROUND
    return labels


def signed_distance(mask: Mask) -> NDArray[np.float32]:
    """Pixels to the outline of a mask (H, W), positive inside; the image's border is no outline."""
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    inside, outside = (
        cv2.distanceTransform(part, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
        for part in (padded, 1 - padded)
    )
    signed: NDArray[np.float32] = np.where(mask, inside - 0.5, 0.5 - outside).astype(np.float32)
    return signed


def distance_outside(mask: Mask) -> NDArray[np.float32]:
    """The same outside a mask alone, at half the price; 0.5 inside it."""
    away = cv2.distanceTransform((~mask).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    signed: NDArray[np.float32] = 0.5 - away
    return signed


def draw_bones(bones: NDArray[np.floating], shape: tuple[int, ...]) -> Mask:
    """Pixels (H, W) on line segments (B, 2, 2) px, one pixel wide."""
    canvas = np.zeros(shape, np.uint8)
    for start, end in bones[np.isfinite(bones).all((1, 2))]:
        clipped = _clip(start, end)
        if clipped is not None:
            ends = [tuple(round(float(x) * (1 << _SHIFT)) for x in p) for p in clipped]
            cv2.line(canvas, ends[0], ends[1], 1, 1, cv2.LINE_8, _SHIFT)
    return canvas > 0


def _clip(
    start: NDArray[np.floating], end: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating]] | None:
    """The part of a segment whose coordinates stay below ``_FAR``, None if there is none."""
    low, high = 0.0, 1.0
    step = end - start
    if max(np.abs(start).max(), np.abs(end).max()) < _FAR / 2:  # as most are
        return start, start + step
    for axis in range(2):
        if step[axis] == 0:
            if abs(start[axis]) > _FAR:
                return None
            continue
        crossings = sorted((side * _FAR - start[axis]) / step[axis] for side in (-1, 1))
        low, high = max(low, crossings[0]), min(high, crossings[1])
    return (start + low * step, start + high * step) if low <= high else None


def _check(model: Mask, bones: NDArray[np.floating]) -> None:
    if model.ndim != 2 or model.dtype != np.bool_:
        raise InputError(
            f"model: is {model.dtype} {model.shape}, expected a bool mask (H, W); compare with 0"
        )
    if bones.ndim != 3 or bones.shape[1:] != (2, 2):
        raise InputError(f"bones: have shape {bones.shape}, expected (B, 2, 2) ends in pixels")
