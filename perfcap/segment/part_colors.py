"""Colours of each person and of each of their body parts (Liu et al. 2013, Eq. 16 and 17)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from perfcap.segment.color_model import ColorModel, ColorSettings, fit_color_model
from perfcap.segment.person_layer import PersonLayer
from perfcap.segment.trimap import Box, Mask
from perfcap.setting_checks import Settings

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]

_ANY_COLOR = float(-3 * np.log(256.0))  # log density of a colour nobody expected


@dataclass(frozen=True)
class PartColorSettings(Settings):
    """How colours of people are learnt and believed.

    Attributes:
        color: mixtures of a part.
        few: pixels of a part below which it has no colours of its own.
        deep: deviations of the outline by which a pixel must lie inside the model to be learnt
            from, and outside of everybody else's.
        least: the same in pixels, at least.
        own: probability that a pixel has the colour of the nearest part rather than of any part.
        surprise: probability that it has neither.
        limit: nats that colours may contribute at most.
    """

    color: ColorSettings = field(default_factory=lambda: ColorSettings(components=3, noise=5.0))
    few: int = 60
    deep: float = 1.5
    least: float = 2.0
    own: float = 0.8
    surprise: float = 0.05
    limit: float = 6.0


@dataclass(frozen=True)
class PartColors:
    """Colours of one person in one view.

    Attributes:
        whole: of all parts together; None where nothing was seen of the person.
        parts: of each of P parts; None where too little was.
    """

    whole: ColorModel | None
    parts: tuple[ColorModel | None, ...]

    def log_density(
        self, pixels: Plane, part: NDArray[np.integer], settings: PartColorSettings
    ) -> Plane:
        """Log density of colours (n, 3) at pixels whose nearest parts are known, (n,)."""
        unknown = np.full(len(pixels), _ANY_COLOR, np.float32)
        if self.whole is None:
            return unknown
        found = self.whole.log_density(pixels)
        for number, own in enumerate(self.parts):
            chosen = np.flatnonzero(part == number)
            if own is None or not len(chosen):
                continue
            density = own.log_density(np.ascontiguousarray(pixels[chosen]))
            mixed = density + np.log(settings.own), found[chosen] + np.log(1 - settings.own)
            found[chosen] = np.logaddexp(*mixed)
        known = found + np.float32(np.log(1 - settings.surprise))
        either: Plane = np.logaddexp(known, unknown + np.float32(np.log(settings.surprise)))
        return either


def learn_part_colors(
    samples: Iterable[tuple[Image, Sequence[PersonLayer]]],
    settings: PartColorSettings | None = None,
) -> tuple[PartColors, ...]:
    """Colours of everybody where they are surely seen, over frames of one view.

    Args:
        samples: images (H, W, 3) with K people in each.
        settings: of the mixtures.
    """
    settings = settings or PartColorSettings()
    seen: list[list[list[Plane]]] = []
    for image, layers in samples:
        seen = seen or [[[] for _ in layer.spread] for layer in layers]
        for number, layer in enumerate(layers):
            if not layer.depth.size:
                continue
            pixels = image[layer.box].astype(np.float32)
            sure = _sure(layers, number, layer.box, settings)
            for part in np.unique(layer.part[sure]):
                if part >= 0:
                    seen[number][part].append(pixels[sure & (layer.part == part)])
    return tuple(_fitted(parts, settings) for parts in seen)


def _sure(
    layers: Sequence[PersonLayer], number: int, box: Box, settings: PartColorSettings
) -> Mask:
    """Where one person is seen for sure, in a part of the image."""
    around = [each.seen_from(box) for each in layers]
    deep = [np.maximum(settings.deep * each.spread, settings.least) for each in around]
    inside: Mask = around[number].distance > deep[number]
    for other, each in enumerate(around):
        if other != number:
            inside &= each.distance < -deep[other]
    return inside


def _fitted(parts: Sequence[Sequence[Plane]], settings: PartColorSettings) -> PartColors:
    none = np.zeros((0, 3), np.float32)
    joined = [np.concatenate(each) if each else none for each in parts]
    own = tuple(
        fit_color_model(each, settings.color) if len(each) >= settings.few else None
        for each in joined
    )
    everything = np.concatenate(joined) if joined else none
    whole = fit_color_model(everything, ColorSettings(noise=settings.color.noise))
    return PartColors(whole, own)
