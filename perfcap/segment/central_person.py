"""The person in the middle of a picture, without a model of anybody.

For videos around one person, or of a person on a turntable. Whoever stands where the camera turns
about moves otherwise in the image than what lies behind: that, and the colours (GrabCut, Rother et
al. 2004), tell the person from the place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.segment.trimap import (
    BACKGROUND,
    FOREGROUND,
    PROBABLE_BACKGROUND,
    PROBABLE_FOREGROUND,
    Labels,
    Mask,
)
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]
Area = tuple[float, float, float, float]

_SURE = 0.6  # evidence of motion that colours do not overrule
_STRIP = 0.006  # of the picture's longest side: what lies so near to an edge of the box is at it
_PLAIN = 0.7  # how far flow is believed without texture

MIDDLE: Area = (0.2, 0.02, 0.8, 0.98)


@dataclass(frozen=True)
class CentralPersonSettings(Settings):
    """How the person in the middle of a picture is found.

    Attributes:
        core: shares of the box's width and height, about its middle, that surely show the person.
        rounds: of GrabCut.
        side: px, pictures are shrunk to this longest side.
        apart: motion of the surroundings, px of the shrunk pictures, below which a second picture
            tells nothing.
        noise: px, least difference of motions that counts.
        certain: times the usual difference in the surroundings from which motion is another one.
        texture: slope of the grey picture, levels a pixel, from which motion is seen.
    """

    core: tuple[float, float] = (0.06, 0.35)
    rounds: int = 6
    side: int = 480
    apart: float = 0.5
    noise: float = 0.6
    certain: float = 2.0
    texture: float = 3.0


def central_person(
    picture: Image,
    others: Sequence[Image] = (),
    box: Area = MIDDLE,
    settings: CentralPersonSettings | None = None,
) -> Mask:
    """Where the person in the middle of a picture is, (H, W).

    Args:
        picture: (H, W, 3) RGB.
        others: the same place from a little before and after, of the same size.
        box: that holds the person, (left, top, right, bottom), shares of the width and height.
        settings: of the search.
    """
    settings = settings or CentralPersonSettings()
    height, width = picture.shape[:2]
    scale = min(1.0, settings.side / max(height, width))
    small, *around = (_shrunk(image, scale) for image in (picture, *others))
    labels = _box_labels(small.shape[:2], box, settings)
    evidence = [_otherwise(small, other, labels, settings) for other in around]
    seen = [each for each in evidence if each is not None]
    told = _told(labels, np.mean(seen, axis=0)) if seen else labels
    if _has_both(told):  # motion that leaves nobody, or nothing else, was misread
        labels = told
    cv2.setRNGSeed(0)
    state = np.zeros((1, 65)), np.zeros((1, 65))
    core = labels == FOREGROUND
    cv2.grabCut(small, labels, None, *state, settings.rounds, cv2.GC_INIT_WITH_MASK)
    found = _connected((labels == FOREGROUND) | (labels == PROBABLE_FOREGROUND), core)
    # bilinear: the outline of a shrunk mask is a staircase in the picture
    soft = cv2.resize(found.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    mask: Mask = soft > 0.5
    return mask


def cut_off(mask: Mask, box: Area) -> dict[str, float]:
    """Share of each edge of the box at which a mask ends: whole people hardly touch them.

    Args:
        mask: (H, W).
        box: as of ``central_person``.
    """
    height, width = mask.shape
    left, right = (round(min(max(share, 0), 1) * width) for share in (box[0], box[2]))
    top, bottom = (round(min(max(share, 0), 1) * height) for share in (box[1], box[3]))
    inside = mask[top:bottom, left:right]
    strip = max(1, round(_STRIP * max(height, width)))
    return {
        "left": float(inside[:, :strip].any(1).mean()),
        "right": float(inside[:, -strip:].any(1).mean()),
        "top": float(inside[:strip].any(0).mean()),
        "bottom": float(inside[-strip:].any(0).mean()),
    }


def _shrunk(image: Image, scale: float) -> Image:
    if scale >= 1:
        return np.ascontiguousarray(image)
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def _box_labels(shape: tuple[int, ...], box: Area, settings: CentralPersonSettings) -> Labels:
    """Background outside of the box, perhaps the person in an ellipse, surely in its core."""
    left, top, right, bottom = box
    across = ((np.arange(shape[1]) + 0.5) / shape[1] - (left + right) / 2) / ((right - left) / 2)
    down = ((np.arange(shape[0]) + 0.5) / shape[0] - (top + bottom) / 2) / ((bottom - top) / 2)
    across, down = np.abs(across)[None], np.abs(down)[:, None]
    labels = np.full(shape, BACKGROUND, np.uint8)
    labels[(across <= 1) & (down <= 1)] = PROBABLE_BACKGROUND
    labels[down**2 + (across / 0.6) ** 2 <= 1] = PROBABLE_FOREGROUND
    labels[(across <= settings.core[0]) & (down <= settings.core[1])] = FOREGROUND
    return labels


def _otherwise(
    picture: Image, other: Image, labels: Labels, settings: CentralPersonSettings
) -> Plane | None:
    """How much a picture moves otherwise than its surroundings do, -1 to 1; 0 is unknown.

    None where the surroundings stand still together with the middle.
    """
    one, two = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (picture, other))
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(one, two, None)
    slope = np.hypot(*(cv2.Sobel(one, cv2.CV_32F, *a, ksize=3) / 8 for a in ((1, 0), (0, 1))))
    textured = cv2.dilate((slope > settings.texture).astype(np.uint8), np.ones((5, 5))) > 0
    outside = (labels == BACKGROUND) & textured
    if int(outside.sum()) < 200:
        return None
    difference = np.linalg.norm(flow - _surroundings(flow, outside), axis=-1)
    usual = max(settings.noise, float(np.quantile(difference[outside], 0.8)))
    strongest = np.quantile(np.linalg.norm(flow[textured], axis=-1), 0.9)
    if strongest < settings.apart:
        return None
    inside = textured & (labels != BACKGROUND)
    # flow is smooth: half way between both motions is where the outline is
    half = 0.5 * float(np.quantile(difference[inside], 0.9)) if inside.any() else 0.0
    told = np.clip(difference / max(half, settings.certain * usual), 0, 2) - 1
    # where nothing is seen to move, flow is what lies around
    believed: Plane = np.where(textured, told, _PLAIN * told).astype(np.float32)
    return believed


def _surroundings(flow: Plane, outside: Mask) -> Plane:
    """Motion of the place, an affine function of the pixel fitted where the person is not."""
    rows, columns = np.nonzero(outside)
    pick = slice(None, None, max(1, len(rows) // 2000))
    start = np.stack((columns, rows), 1).astype(np.float32)[pick]
    end = (start + flow[rows, columns][pick]).astype(np.float32)
    matrix, _ = cv2.estimateAffine2D(start[:, None], end[:, None], ransacReprojThreshold=1.5)
    if matrix is None:
        return np.broadcast_to(np.median(flow[outside], axis=0), flow.shape)
    y, x = np.mgrid[: flow.shape[0], : flow.shape[1]].astype(np.float32)
    moved = np.stack((x, y, np.ones_like(x)), -1) @ matrix.T.astype(np.float32)
    shift: Plane = moved - np.stack((x, y), -1)
    return shift


def _told(labels: Labels, evidence: Plane) -> Labels:
    """Labels inside the box, changed where motion says otherwise."""
    smooth = cv2.GaussianBlur(evidence.astype(np.float32), (0, 0), 1.5)
    told = labels.copy()
    open_ = labels != BACKGROUND
    told[open_ & (smooth > 0.0)] = PROBABLE_FOREGROUND
    told[open_ & (smooth < 0.0)] = PROBABLE_BACKGROUND
    told[open_ & (smooth > _SURE)] = FOREGROUND
    told[open_ & (smooth < -_SURE)] = BACKGROUND
    told[(labels == FOREGROUND) & (told == BACKGROUND)] = PROBABLE_BACKGROUND
    return told


def _has_both(labels: Labels) -> bool:
    """Whether there is a person and a place: GrabCut needs pixels of either."""
    person = (labels == FOREGROUND) | (labels == PROBABLE_FOREGROUND)
    return bool(person.any() and not person.all())


def _connected(mask: Mask, core: Mask) -> Mask:
    """The largest connected part that meets the core."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=4
    )
    met = np.unique(labels[core & mask])
    met = met[met > 0]
    names = met if len(met) else np.arange(1, count)
    if not len(names):
        return mask
    part: Mask = labels == names[stats[names, cv2.CC_STAT_AREA].argmax()]
    return part
