"""The person in one frame, from the posed model (Xu 2018, Sec. 5.1).

GrabCut (Rother et al. 2004) inside the uncertain band of the model's trimap, extended by the
temporal gradient between adjacent frames. The default also asks, where there is one, a plate of
the background, and believes the model a little: more than the paper has. ``PAPER`` is the
published form.

A person who is large in the image is first found in a shrunk image; the full image then decides
along the boundary alone, where its pixels matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.segment.background import Plate, find_lighting
from perfcap.segment.evidence import (
    Backdrop,
    ColorModels,
    Pixels,
    choose,
    explained,
    learn_colors,
    log_ratio,
)
from perfcap.segment.mixed_pixels import settle_mixed
from perfcap.segment.motion_cue import MotionCue, temporal_gradient
from perfcap.segment.random_field import BandField
from perfcap.segment.settings import GrabCutSettings
from perfcap.segment.trimap import BACKGROUND, FOREGROUND, Mask, Trimap, signed_distance

Plane = NDArray[np.float32]
Image = NDArray[np.uint8]

_PLAIN = 8.0  # grey levels between the darkest and the brightest hundredth
_SPARSE = 4  # px between those that are looked at


@dataclass(frozen=True)
class FrameReport:
    """What the segmentation of a frame could rely on.

    Attributes:
        person: whether the model is in the image at all.
        motion: whether the motion cue was used.
        change: median change of the surroundings between frames, grey levels; NaN if unknown.
        plate: share of the uncertain band for which there was a plate, 0 without.
        noise: deviation of the surroundings from the plate, grey levels; NaN without.
        cut: whether the scene changed since the previous frame.
        cropped: whether the image's border cuts the model off.
        agreement: intersection over union of the mask and a network's, around the person; NaN
            where none was asked.
        given: whether the mask was known, and nothing was looked at.
        beside: whether a known mask lies beside the model: it is of somebody else, and not used.
        blank: whether the image is of one color around the person: nothing is seen, the mask empty.
    """

    person: bool
    motion: bool = False
    change: float = float("nan")
    plate: float = 0.0
    noise: float = float("nan")
    cut: bool = False
    cropped: bool = False
    agreement: float = float("nan")
    given: bool = False
    blank: bool = False
    beside: bool = False


@dataclass(frozen=True)
class Segmentation:
    """The person in one frame and view.

    Attributes:
        mask: (H, W).
        trimap: the regions it was found in.
        evidence: nats in favour of the person in the trimap's box, (h, w), zero outside the band.
        image: the box, (h, w, 3) RGB.
        models: colours, to start the next frame from; None if nothing could be learnt.
        report: what it relies on.
    """

    mask: Mask
    trimap: Trimap
    evidence: Plane
    image: Image
    models: ColorModels | None
    report: FrameReport


@dataclass(frozen=True)
class _View:
    """The trimap's box at one resolution."""

    image: Plane
    trimap: Trimap
    backdrop: Backdrop | None
    motion: Plane | None
    network: Plane | None


@dataclass(frozen=True)
class _Labels:
    """A labelling of a view: (h, w) each."""

    inside: Mask
    evidence: Plane
    models: ColorModels | None


def segment(
    frame: Image,
    trimap: Trimap,
    settings: GrabCutSettings | None = None,
    *,
    adjacent: Sequence[Image] = (),
    plate: Plate | None = None,
    network: Plane | None = None,
    warm: ColorModels | None = None,
) -> Segmentation:
    """Find the person in a frame.

    Args:
        frame: (H, W, 3) RGB.
        trimap: of the posed model.
        settings: weights and widths; the measured best if None.
        adjacent: the trimap's box in the previous and the next frame, (h, w, 3), registered where
            the camera moves; none across a cut.
        plate: the background in the trimap's box.
        network: nats by which a network speaks for the person there, (h, w).
        warm: colours of the previous frame.

    Raises:
        InputError: a frame of other size or type than the trimap's.
    """
    settings = settings or GrabCutSettings()
    _check(frame, trimap, adjacent, plate)
    image = frame[trimap.box]
    mask = np.zeros(trimap.shape, np.bool_)
    if not trimap.size:
        nothing = np.zeros(trimap.labels.shape, np.float32)
        return Segmentation(mask, trimap, nothing, image, warm, FrameReport(False))
    if _is_blank(image):
        nothing = np.zeros(trimap.labels.shape, np.float32)
        report = FrameReport(True, cropped=trimap.cropped, blank=True)
        return Segmentation(mask, trimap, nothing, image, warm, report)
    scale = 1.0 if settings.coarse is None else min(1.0, settings.coarse / trimap.size)
    plate = plate if settings.use_plate else None
    view, report = _look(image, trimap, adjacent, plate, settings, scale)
    if network is not None:
        view = replace(view, network=_enlarge(network, view.trimap.labels.shape))
    found = _iterate(view, warm, settings)
    if scale < 1:
        view = replace(_narrow(image, trimap, plate, view, found, settings, scale), network=network)
        found = _follow_boundary(view, found, settings)
    mask[trimap.box] = found.inside
    if view.backdrop is not None:
        mask[trimap.box] = settle_mixed(found.inside, image, view.backdrop, trimap.band)
    return Segmentation(mask, trimap, found.evidence, image, found.models, report)


def _is_blank(image: Image) -> bool:
    """Whether all but the extremes of an image (h, w, 3) is of one color: black, covered, glare."""
    sample = image[::_SPARSE, ::_SPARSE].reshape(-1, 3)
    return not any(_spread(channel) >= _PLAIN for channel in sample.T)


def _spread(levels: NDArray[np.uint8]) -> float:
    """From the darkest to the brightest hundredth: the quantiles of bytes, which are counted."""
    below = np.bincount(levels, minlength=256).cumsum()
    places = np.array((0.01, 0.99)) * (len(levels) - 1)
    first, share = np.floor(places).astype(np.int64), places % 1
    one, other = (np.searchsorted(below, first + step, "right") for step in (0, share > 0))
    low, high = one + share * (other - one)
    return float(high - low)


def _look(
    image: Image,
    trimap: Trimap,
    adjacent: Sequence[Image],
    plate: Plate | None,
    settings: GrabCutSettings,
    scale: float,
) -> tuple[_View, FrameReport]:
    """Everything there is to see, at a scale of at most one."""
    full = trimap
    if scale < 1:
        trimap = trimap.resize(scale)
        shape = trimap.labels.shape
        image, *adjacent = (_shrink(picture, shape) for picture in (image, *adjacent))
        plate = None if plate is None else plate.resize(shape)
    pixels = image.astype(np.float32)
    around = trimap.labels == BACKGROUND
    cue = MotionCue(None, float("nan"))
    if settings.smoothness.temporal > 0:
        others = [picture.astype(np.float32) for picture in adjacent]
        cue = temporal_gradient(pixels, others, around, settings.motion)
    lighting = None
    if plate is not None:
        lighting = find_lighting(pixels, around, plate, settings.plate, trimap.contact)
    backdrop = None if plate is None or lighting is None else Backdrop(plate, lighting)
    moves = cue.gradient is not None
    report = FrameReport(full.size > 0, moves, cue.level, cropped=full.cropped)
    if backdrop is not None:
        band = trimap.band
        share = float(backdrop.plate.known[band].mean()) if band.any() else 0.0
        report = replace(report, plate=share, noise=backdrop.lighting.noise)
    return _View(pixels, trimap, backdrop, cue.gradient, None), report


def _iterate(view: _View, warm: ColorModels | None, settings: GrabCutSettings) -> _Labels:
    """Learn colours, cut, and again."""
    inside = view.trimap.model
    person = inside & ~explained(view.image, inside, view.backdrop, settings)
    found = _Labels(inside, np.zeros(inside.shape, np.float32), warm)
    if not view.trimap.band.any():
        return found
    pixels, field = _pixels(view, settings), _field(view, settings)
    # colours of the previous frame are as good as a round
    for _ in range(settings.rounds if warm is None else max(1, settings.rounds - 1)):
        models = learn_colors(view.image, person, found.inside, found.models, settings.color)
        found = _label(view, models, settings, pixels, field)
        person = found.inside
    return found


def _pixels(view: _View, settings: GrabCutSettings) -> Pixels:
    return Pixels.of(view.image, view.trimap.band, view.backdrop, settings)


def _field(view: _View, settings: GrabCutSettings) -> BandField:
    return BandField(view.trimap, view.image, settings.smoothness, view.motion)


def _label(
    view: _View,
    models: ColorModels | None,
    settings: GrabCutSettings,
    pixels: Pixels,
    field: BandField,
) -> _Labels:
    """The labelling of least energy, given colours."""
    trimap = view.trimap
    band = trimap.band
    ratio = np.zeros(len(pixels.colors), np.float32)
    if models is not None:
        ratio = log_ratio(pixels, models, settings)
    prior = choose(pixels.known, settings.backed.prior, settings.alone.prior)
    depth = np.clip(trimap.distance[band] / max(trimap.inner, 1.0), -1, 1)
    believed = ratio + prior * depth
    if view.network is not None:
        believed += view.network[band]
    evidence = np.zeros(band.shape, np.float32)
    evidence[band] = ratio
    return _Labels(field.settle(believed), evidence, models)


def _narrow(
    image: Image,
    trimap: Trimap,
    plate: Plate | None,
    coarse: _View,
    found: _Labels,
    settings: GrabCutSettings,
    scale: float,
) -> _View:
    """The full image, open only near the boundary that was found in a shrunk one."""
    shape = trimap.labels.shape
    boundary = _enlarge(signed_distance(found.inside), shape) / scale
    sure = np.where(boundary > 0, FOREGROUND, BACKGROUND)
    far = np.abs(boundary) > settings.narrow / scale
    labels = np.where(trimap.band & far, sure, trimap.labels).astype(np.uint8)
    backdrop = None
    if plate is not None and coarse.backdrop is not None:
        backdrop = Backdrop(plate, coarse.backdrop.lighting.resize(shape))
    motion = None if coarse.motion is None else _enlarge(coarse.motion, shape)
    return _View(image.astype(np.float32), replace(trimap, labels=labels), backdrop, motion, None)


def _follow_boundary(view: _View, coarse: _Labels, settings: GrabCutSettings) -> _Labels:
    """Decide again where the view is open; evidence elsewhere is the coarse one's."""
    pixels, field = _pixels(view, settings), _field(view, settings)
    fine = _label(view, coarse.models, settings, pixels, field)
    around = _enlarge(coarse.evidence, view.trimap.labels.shape)
    return replace(fine, evidence=np.where(view.trimap.band, fine.evidence, around))


def _shrink(image: Image, shape: tuple[int, ...]) -> Image:
    return np.asarray(cv2.resize(image, shape[1::-1], interpolation=cv2.INTER_AREA), np.uint8)


def _enlarge(plane: Plane, shape: tuple[int, ...]) -> Plane:
    enlarged: Plane = cv2.resize(plane, shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return enlarged


def _check(frame: Image, trimap: Trimap, adjacent: Sequence[Image], plate: Plate | None) -> None:
    part = (*trimap.labels.shape, 3)
    pictures = [("frame", frame, (*trimap.shape, 3))]
    pictures += [("adjacent", other, part) for other in adjacent]
    if plate is not None:
        pictures.append(("plate", plate.color, part))
    for name, picture, expected in pictures:
        if picture.shape != expected or picture.dtype != np.uint8:
            raise InputError(
                f"{name}: is {picture.dtype} {picture.shape}, expected uint8 RGB {expected} as "
                "the trimap has; use pictures of one size"
            )
