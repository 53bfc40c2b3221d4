"""What a pixel's colour says about the person being there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.segment import _color_numba
from perfcap.segment.background import Lighting, Plate, background_density
from perfcap.segment.color_model import ColorModel, ColorSettings, fit_color_model, thinned
from perfcap.segment.settings import GrabCutSettings
from perfcap.segment.trimap import Mask

Plane = NDArray[np.float32]

_ANY_COLOR = float(-3 * np.log(256.0))  # log density of a colour nobody expected
_FEW = 50  # pixels, too few to learn colours from


@dataclass(frozen=True)
class Backdrop:
    """What is known about the background of an image (h, w): the plate, and how it is lit."""

    plate: Plate
    lighting: Lighting


@dataclass(frozen=True)
class ColorModels:
    """Colours of the person and of what surrounds them."""

    foreground: ColorModel
    background: ColorModel


def learn_colors(
    image: Plane, person: Mask, inside: Mask, warm: ColorModels | None, settings: ColorSettings
) -> ColorModels | None:
    """Colours of both sides of a labelling; None where a side has no pixels and never had.

    Args:
        image: (h, w, 3).
        person: pixels to learn the person's colours from, (h, w); all inside if they are few.
        inside: the labelling, (h, w).
        warm: colours to start from, and to keep where there is nothing to learn from.
        settings: of the mixtures.
    """
    chosen = person if int(person.sum()) >= _FEW else inside
    before = (None, None) if warm is None else (warm.foreground, warm.background)
    foreground, background = (
        fit_color_model(thinned(image, region, settings), settings, start) or start
        for region, start in zip((chosen, ~inside), before, strict=True)
    )
    if foreground is None or background is None:
        return None
    return ColorModels(foreground, background)


def explained(
    image: Plane, inside: Mask, backdrop: Backdrop | None, settings: GrabCutSettings
) -> Mask:
    """Pixels ``inside`` (h, w) that look more like the plate than like just any colour."""
    fits: Mask = np.zeros(inside.shape, np.bool_)
    if backdrop is not None:
        asked = inside & backdrop.plate.known
        density = background_density(
            image, asked, backdrop.plate, backdrop.lighting, settings.plate
        )
        fits[asked] = density > _ANY_COLOR
    return fits


@dataclass(frozen=True)
class Pixels:
    """Some pixels, and what the plate says about them: it stays as colours are learnt anew.

    Attributes:
        colors: (n, 3).
        known: whether there is a plate, (n,); None if nowhere.
        backed: log density if they show the plate, (n,); likewise.
    """

    colors: Plane
    known: Mask | None
    backed: Plane | None

    @classmethod
    def of(
        cls, image: Plane, chosen: Mask, backdrop: Backdrop | None, settings: GrabCutSettings
    ) -> Pixels:
        """The ``chosen`` (h, w) of an image (h, w, 3)."""
        colors = image.reshape(-1, 3)[np.flatnonzero(chosen)]
        if backdrop is None:
            return cls(colors, None, None)
        plate = backdrop.plate
        backed = background_density(image, chosen, plate, backdrop.lighting, settings.plate)
        return cls(colors, plate.known[chosen], backed)


def log_ratio(pixels: Pixels, models: ColorModels, settings: GrabCutSettings) -> Plane:
    """Nats in favour of the person at some pixels, (n,), limited."""
    colors, known, backed = pixels.colors, pixels.known, pixels.backed
    alone, clear = _odds(settings.alone.surprise), _odds(settings.backed.surprise)
    # the person may always have hidden it
    unseen = _odds(settings.unseen)
    if settings.use_colors:
        person, scene = models.foreground.log_density(colors), models.background.log_density(colors)
    else:
        person = scene = np.full(len(colors), _ANY_COLOR, np.float32)
        alone = clear = unseen = _odds(0.0)
    if known is None or backed is None:
        known, backed = np.zeros(0, np.bool_), np.zeros(0, np.float32)
    last = np.log([settings.plate.clutter]).astype(np.float32), np.array([settings.limit], "f4")
    ratio = np.empty(len(colors), np.float32)
    _color_numba.weigh(person, scene, known, backed, alone, clear, unseen, *last, ratio)
    return ratio


def _odds(unknown: float) -> Plane:
    """Logs of the probability of colours as expected, and of that of just any colour, (2,)."""
    with np.errstate(divide="ignore"):  # none is unknown: log 0
        share = np.array([1 - np.float32(unknown), unknown], np.float32)
        odds: Plane = np.log(share) + np.array([0, _ANY_COLOR], np.float32)
    return odds


def choose(known: Mask | None, backed: float, alone: float) -> Plane:
    """One value where the background is known, another elsewhere."""
    if known is None:
        return np.full((), alone, np.float32)
    return np.where(known, np.float32(backed), np.float32(alone))
