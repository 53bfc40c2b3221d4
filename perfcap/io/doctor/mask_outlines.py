"""Whether masks end where the images have edges: too large or small, boxes, of another video."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.io.clip import FrameReader
from perfcap.io.doctor.mask_joints import limb_doubts, others_doubts
from perfcap.io.doctor.moved_outlines import Registration, moved_sentences, register

Floats = NDArray[np.float64]

_REACH = 0.06  # of the person's height: how far from the outline edges are looked for
_OFF = 0.008  # of it: how far they may lie from the outline, 1.5 cm
_LEAST = 1.5  # px, likewise
_CLEAR = 1.5  # times the usual gradient; sound masks have 2.2 to 5.4
_BLUR = 1.0  # px


@dataclass(frozen=True, eq=False)
class MaskedFrames:
    """Some frames that have masks in every view.

    Attributes:
        names: of the C views.
        reader: of their F images.
        detections: (F, C), in pixels of the images.
        inside: where the masks are, (F, C, H, W), bool or 0 to 1; those of smaller views padded.
        known: which pixels say anything, of a shape that broadcasts to ``inside``; all if None.
    """

    names: Sequence[str]
    reader: FrameReader
    detections: Detections
    inside: Tensor
    known: Tensor | None = None


def mask_doubts(shown: MaskedFrames) -> Iterator[str]:
    """Sentences about views whose masks are of somebody else, or end elsewhere than the person.

    Args:
        shown: the frames, whose masks a surface is to follow.
    """
    given = shown.names, shown.detections, shown.inside, shown.known
    yield from limb_doubts(*given)
    yield from others_doubts(*given, numbered=True)
    yield from outline_doubts(shown, girths=False)


@dataclass(frozen=True)
class OutlineEdges:
    """Image gradients along the outlines of a view's masks, over all frames.

    Attributes:
        offset: px inside the outline (negative: outside) where gradients are largest.
        clarity: gradient there over the median of those within reach; 1 where nothing is seen.
        size: of the person, px.
    """

    offset: float
    clarity: float
    size: float


def outline_doubts(shown: MaskedFrames, *, girths: bool = True) -> Iterator[str]:
    """Sentences about views whose masks do not end at edges of the images.

    Args:
        shown: the frames.
        girths: whether those of a body follow the masks; else it is a surface.
    """
    for view, found in enumerate(outline_edges(shown)):
        name, off = shown.names[view], abs(found.offset)
        if found.clarity < _CLEAR:
            follows = "Girths follow them" if girths else "The surface follows them"
            yield (
                f"masks of {name}: end at no edges of the images; are they boxes, rough, or of "
                f"another video? {follows}"
            )
        elif off > max(_LEAST, _OFF * found.size):
            far = f"{off:.0f} px ({100 * off / found.size:.1f} % of the person's height)"
            kind, what = ("larger", "outside") if found.offset > 0 else ("smaller", "inside")
            follows = "the surface follows them"
            if girths:
                follows = f"girths are {kind} by three to six times that"
            yield (
                f"masks of {name}: end about {far} {what} the edges of the images; {follows}, give "
                "masks that end where the person does"
            )
        else:
            yield from moved_sentences(name, registration(shown, view, found.size))


def registration(shown: MaskedFrames, view: int, size: float) -> tuple[Registration, Registration]:
    """How masks of a view would fit its images better, across and down."""
    return register(_frames(shown, view), size)


def outline_edges(shown: MaskedFrames) -> list[OutlineEdges]:
    """For each view, where the images have their edges as seen from the outlines."""
    sizes = shown.detections.box_heights().tolist()
    return [_of_view(shown, view, size) for view, size in enumerate(sizes)]


def _of_view(shown: MaskedFrames, view: int, size: float) -> OutlineEdges:
    reach = max(4, round(_REACH * size))
    total, count = np.zeros(2 * reach), np.zeros(2 * reach)
    for image, mask in _frames(shown, view):
        if mask.any() and not mask.all():
            # pixels of straight outlines lie at halves of a pixel: one row of them to a bin
            depth = np.floor(_depth(mask)).astype(np.int64)
            near = (depth >= -reach) & (depth < reach)
            place = depth[near] + reach
            total += np.bincount(place, _gradient(image)[near], len(total))
            count += np.bincount(place, minlength=len(count))
    if not (count > 0).all():
        return OutlineEdges(0.0, 1.0 if not count.any() else _CLEAR, size)
    profile = total / count
    usual = max(float(np.median(profile)), 1e-9)
    best = int(profile.argmax())
    return OutlineEdges(best - reach + 0.5, float(profile[best]) / usual, size)


def _frames(
    shown: MaskedFrames, view: int
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.bool_]]]:
    """Images and masks of a view."""
    for frame in range(len(shown.inside)):
        image = shown.reader.read_view(view, frame, frame + 1)[0]
        height, width = image.shape[:2]
        yield image, shown.inside[frame, view, :height, :width].numpy() > 0.5


def _depth(mask: NDArray[np.bool_]) -> Floats:
    """Distance of each pixel inside the outline, px; negative outside."""
    inside, outside = (
        cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for part in (mask, ~mask)
    )
    # the outline lies half a pixel from the last pixel of either side
    depth: Floats = np.where(mask, inside - 0.5, 0.5 - outside).astype(np.float64)
    return depth


def _gradient(image: NDArray[np.uint8]) -> Floats:
    """Largest length of the gradients of the channels, (H, W)."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR)
    across, down = cv2.Sobel(smooth, -1, 1, 0), cv2.Sobel(smooth, -1, 0, 1)
    length: Floats = np.hypot(across, down).max(-1).astype(np.float64)
    return length
