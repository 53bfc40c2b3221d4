"""What a pixel's colour says about the person being there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    colors, known = pixels.colors, pixels.known
    surprise = choose(known, settings.backed.surprise, settings.alone.surprise)
    if settings.use_colors:
        person = _mixed(models.foreground.log_density(colors), surprise)
        # the person may always have hidden it
        scene = _mixed(models.background.log_density(colors), np.float32(settings.unseen))
    else:
        person = scene = np.full(len(colors), _ANY_COLOR, np.float32)
    if pixels.backed is not None and known is not None:
        clutter = scene + np.float32(np.log(settings.plate.clutter))
        scene = np.where(known, np.logaddexp(pixels.backed, clutter), scene)
    ratio: Plane = np.clip(person - scene, -settings.limit, settings.limit)
    return ratio


def _mixed(density: Plane, unknown: Plane | np.float32) -> Plane:
    """Log density of colours that are as expected, or with some probability just any colour."""
    with np.errstate(divide="ignore"):  # none is unknown: log 0
        mixed: Plane = np.logaddexp(density + np.log(1 - unknown), _ANY_COLOR + np.log(unknown))
    return mixed


def choose(known: Mask | None, backed: float, alone: float) -> Plane:
    """One value where the background is known, another elsewhere."""
    if known is None:
        return np.full((), alone, np.float32)
    return np.where(known, np.float32(backed), np.float32(alone))
