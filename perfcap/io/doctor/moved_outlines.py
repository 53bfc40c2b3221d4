"""How masks of a view would have to be moved or stretched to end at the edges of its images."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SHIFTS = np.linspace(-0.06, 0.06, 25)  # of the person's height, 0.5 % apart
_STRETCHES = np.linspace(-0.1, 0.1, 21)  # of the mask's extent about its middle, 1 % apart
# Mean gradient there over that where the masks end (``experiments/moved_masks.py``)
_GAIN = 1.3
_OFF = 0.012  # of the extent, that the masks' ends must move
_SLACK, _LEAST = 0.008, 2  # of the size, and px: edges so near to outlines are where they end
_ACROSS = 0.8  # cosine between an outline's normal and an axis that it tells of
_FEWEST = 40  # points of outlines
_BLUR, _ROUND = 1.0, 2.0  # px: of images, and of masks for their normals
_GLARING = 8.0  # times the mean gradient of an image, beyond which edges count no more


@dataclass(frozen=True)
class Registration:
    """Along one axis of the images.

    Attributes:
        shift: of the masks, to the right or down, shares of the person's size.
        stretch: of the masks about their middle, share of their extent.
        gain: mean gradient at the outlines so moved over that at the outlines; 1 where that is not
            known.
    """

    shift: float
    stretch: float
    gain: float

    @property
    def moved(self) -> bool:
        """Whether outlines clearly fit better elsewhere."""
        return self.gain > _GAIN and abs(self.shift) + 0.5 * abs(self.stretch) > _OFF


def register(
    frames: Iterable[tuple[NDArray[np.uint8], Mask]], size: float
) -> tuple[Registration, Registration]:
    """The best shift and stretch of masks, across and down.

    Upright outlines say nothing of where a person ends above and below: each axis has the parts of
    the outline that lie across it, as heads, shoulders and soles for the way down.

    Args:
        frames: images (H, W, 3) and masks (H, W) of a view.
        size: of the person, px.
    """
    shape = len(_SHIFTS), len(_STRETCHES)
    total, count = np.zeros((2, *shape)), [0, 0]
    for image, mask in frames:
        if not mask.any() or mask.all():
            continue
        places, normals = _outline(mask)
        for axis, gradient in enumerate(_gradients(image)):
            told = places[np.abs(normals[:, axis]) > _ACROSS]
            total[axis] += _seen(gradient, told, axis, mask, size)
            count[axis] += len(told)
    across, down = (
        _best(sums) if number >= _FEWEST else Registration(0.0, 0.0, 1.0)
        for sums, number in zip(total, count, strict=True)
    )
    return across, down


def moved_sentences(name: str, found: tuple[Registration, Registration]) -> Iterator[str]:
    """What there is to say of masks that fit better elsewhere."""
    words = []
    for each, (less, more), kind in zip(
        found,
        (("to the left", "to the right"), ("further up", "further down")),
        ("wide", "tall"),
        strict=True,
    ):
        if not each.moved:
            continue
        if abs(each.shift) > _OFF / 2:
            side = more if each.shift > 0 else less
            words.append(f"{100 * abs(each.shift):.1f} % of the person's height {side}")
        if abs(each.stretch) > _OFF:
            words.append(f"{1 + each.stretch:.2f} times as {kind}")
    if words:
        yield (
            f"masks of {name}: would end at the edges of the images {' and '.join(words)}; were "
            "they resized with borders, or made of other pixels than the video's?"
        )


def _outline(mask: Mask) -> tuple[NDArray[np.int64], Floats]:
    """Pixels (N, 2) along the outlines of a mask, not at the image's border, and their normals."""
    height, width = mask.shape
    plain = mask.astype(np.uint8)
    found, _ = cv2.findContours(plain, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    places = np.concatenate([each[:, 0] for each in found]).astype(np.int64)
    inner = (places > 2).all(1) & (places < np.array([width - 3, height - 3])).all(1)
    places = places[inner]
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), _ROUND)
    slopes = np.stack((cv2.Sobel(soft, -1, 1, 0), cv2.Sobel(soft, -1, 0, 1)), -1)
    normals = slopes[places[:, 1], places[:, 0]].astype(np.float64)
    return places, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)


def _gradients(image: NDArray[np.uint8]) -> Iterator[Floats]:
    """Largest of the channels along each axis, (H, W), times their mean."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR)
    for along in ((1, 0), (0, 1)):
        steep = np.abs(cv2.Sobel(smooth, -1, *along)).max(-1).astype(np.float64)
        yield np.minimum(steep / max(float(steep.mean()), 1e-6), _GLARING)


def _seen(
    gradient: Floats, places: NDArray[np.int64], axis: int, mask: Mask, size: float
) -> Floats:
    """Sums of the gradients at outlines that are moved and stretched along an axis."""
    extent = np.flatnonzero(mask.any(axis))
    middle = 0.5 * (extent[0] + extent[-1])
    field = np.ascontiguousarray(gradient if axis else gradient.T)  # the axis first
    slack = max(_LEAST, round(_SLACK * size))
    field = cv2.dilate(field, np.ones((2 * slack + 1, 1), np.uint8)).astype(np.float64)
    stretched = middle + (places[:, axis] - middle) * (1 + _STRETCHES[:, None])
    aside = np.broadcast_to(places[:, 1 - axis], stretched.shape)
    sums = [
        field[np.clip(np.rint(stretched + shift * size), 0, len(field) - 1).astype(int), aside]
        for shift in _SHIFTS
    ]
    return np.stack([each.sum(1) for each in sums])


def _best(sums: Floats) -> Registration:
    shift, stretch = np.unravel_index(int(sums.argmax()), sums.shape)
    still = float(sums[len(_SHIFTS) // 2, len(_STRETCHES) // 2])
    gain = float(sums.max()) / max(still, 1e-9)
    return Registration(float(_SHIFTS[shift]), float(_STRETCHES[stretch]), gain)
