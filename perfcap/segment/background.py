"""What the camera sees behind the person: a plate, and how well a pixel fits it.

Where the camera stands still, and wherever the person moves aside at some time, the plate says
far more than colours do. A pixel that shows background has the plate's colour, or the same colour
darkened by a shadow; a shadow keeps the texture, a person does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_shape
from perfcap.errors import InputError
from perfcap.segment import _background_numba
from perfcap.segment.trimap import Box, Mask
from perfcap.setting_checks import Settings
from perfcap.workers import ordered_map

Plane = NDArray[np.float32]
Image = NDArray[np.uint8]

_QUARTILES = 1.35  # interquartile range of a normal distribution of unit deviation
_CHI_SQUARED_MEDIAN = 2.366  # three degrees of freedom
_LEAST, _SAMPLES = 100, 4000  # pixels of the surroundings
_MOST = 255  # images, which bytes can count
_BAND = 64  # rows of a plate worked on at once
_DARK = 30  # grey levels below which a ratio says nothing about exposure


@dataclass(frozen=True)
class Shade:
    """Shadows in which the plate may lie: how dark, and how well they keep its texture.

    Attributes:
        window: px, side of the neighbourhood in which a shadow must keep the texture.
        darkest: share of the light that is left in a shadow.
        brightest: light, relative to the plate's, where the plate itself lies in shadow.
        tint: share by which light on one channel may differ from that on all.
        slope: grey levels by which colours depart where light varies in a neighbourhood.
        texture: nats for each unit by which a neighbourhood departs from its shadow.
    """

    window: int = 7
    darkest: float = 0.35
    brightest: float = 1.8
    tint: float = 0.06
    slope: float = 3.0
    texture: float = 2.0


@dataclass(frozen=True)
class PlateSettings(Settings):
    """How plates are made and compared with.

    Attributes:
        least: images that must show a pixel's background.
        clearance: kept from the model when its surroundings count as background, as a share of
            its size.
        jitter: px, how far edges of the background wander (compression, vibration).
        noise: least standard deviation of a colour, grey levels.
        unsteady: deviation of the surroundings, grey levels, above which a plate is not used.
        shade: shadows anywhere.
        contact: shadows around feet that stand on the ground: darker, and they end within pixels.
        shadow_noise: standard deviation of colours in shadow, added, grey levels.
        shadow_prior: probability that background lies in shadow.
        clutter: probability that background does not fit the plate at all.
    """

    least: int = 3
    clearance: float = 0.05
    jitter: float = 0.4
    noise: float = 3.0
    unsteady: float = 16.0
    shade: Shade = field(default_factory=Shade)
    contact: Shade = field(
        default_factory=lambda: Shade(5, darkest=0.2, brightest=1.1, slope=10.0, texture=1.0)
    )
    shadow_noise: float = 3.0
    shadow_prior: float = 0.1
    clutter: float = 0.001


@dataclass(frozen=True)
class Plate:
    """The scene without the person.

    Attributes:
        color: (h, w, 3) uint8 RGB.
        deviation: standard deviation of a pixel's colour, (h, w) float32 grey levels.
        known: (h, w), where the background was ever seen.
    """

    color: Image
    deviation: Plane
    known: Mask

    def __getitem__(self, box: Box) -> Plate:
        """A part."""
        return Plate(self.color[box], self.deviation[box], self.known[box])

    def resize(self, shape: tuple[int, ...]) -> Plate:
        """Shrunk to (h, w)."""
        size = shape[1::-1]
        known = cv2.resize(self.known.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        deviation = cv2.resize(self.deviation, size, interpolation=cv2.INTER_LINEAR)
        return Plate(cv2.resize(self.color, size, interpolation=cv2.INTER_AREA), deviation, known)


@dataclass(frozen=True)
class Lighting:
    """How the plate is lit in one image.

    Attributes:
        gain: exposure of the image relative to the plate, by channel, (3,).
        noise: standard deviation of the surroundings from the plate, grey levels.
        light: that explains each pixel best, by channel, (h, w, 3), relative to the gain.
        strain: nats against that explanation, from the pixel's neighbourhood, (h, w).
    """

    gain: Plane
    noise: float
    light: Plane
    strain: Plane

    def resize(self, shape: tuple[int, ...]) -> Lighting:
        """Enlarged to (h, w)."""
        light, strain = (
            cv2.resize(plane, shape[1::-1], interpolation=cv2.INTER_LINEAR)
            for plane in (self.light, self.strain)
        )
        return Lighting(self.gain, self.noise, light, strain)


def build_plate(
    images: Sequence[Image],
    hidden: Sequence[Mask],
    settings: PlateSettings,
    workers: int | None = 1,
) -> Plate:
    """The median of registered images (H, W, 3), n of them, where they are not ``hidden`` (H, W).

    Args:
        images: at most 255.
        hidden: one for each.
        settings: how it is made.
        workers: threads, that share the rows; all cores when None.

    Raises:
        InputError: no images or more than 255, or arrays that do not fit each other.
    """
    if not 1 <= len(images) <= _MOST or len(hidden) != len(images):
        raise InputError(
            f"a plate of {len(images)} images and {len(hidden)} masks; expected 1 to {_MOST}, as "
            "many of both"
        )
    shape = images[0].shape[:2]
    for image, mask in zip(images, hidden, strict=True):
        require_shape(image, "image of a plate", (*shape, 3), "(H, W, 3), all of one size")
        require_shape(mask, "mask of a plate", shape, "(H, W) of its image")
    height = len(images[0])
    bands = [slice(row, row + _BAND) for row in range(0, height, _BAND)]

    def median(rows: slice) -> tuple[Image, Plane, Image]:
        shown: Image = np.stack([image[rows] for image in images])
        closed: Mask = np.stack([mask[rows] for mask in hidden])
        shape = shown.shape[1:3]
        found = np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.float32), np.zeros(shape, "u1")
        _background_numba.masked_median(shown, closed, *found)
        return found

    parts = zip(*ordered_map(median, bands, workers), strict=True)
    color, spread, seen = (np.concatenate(part) for part in parts)
    slope = np.empty_like(spread)
    _background_numba.squared_slope(
        cv2.copyMakeBorder(color, 1, 1, 1, 1, cv2.BORDER_REFLECT_101), slope
    )
    variance = (spread / _QUARTILES) ** 2 + settings.jitter**2 * slope
    return Plate(color, np.sqrt(variance).astype(np.float32), seen >= settings.least)


def find_lighting(
    image: Plane,
    surroundings: Mask,
    plate: Plate,
    settings: PlateSettings,
    contact: Mask | None = None,
) -> Lighting | None:
    """How the plate is lit in an image (h, w, 3) of the same part.

    Exposure and noise are taken from the ``surroundings`` (h, w), which surely show background;
    None where they do not fit: the camera has moved, or the scene has changed. Around feet, at
    ``contact`` (h, w), shadows are of another kind (``PlateSettings.contact``).
    """
    shape = plate.known.shape
    require_shape(image, "image", (*shape, 3), "(h, w, 3) of the plate's part")
    for name, mask in (("surroundings", surroundings), ("contact", contact)):
        if mask is not None:
            require_shape(mask, name, shape, "(h, w) of the plate's part")
    sample = np.nonzero((surroundings & plate.known).ravel())[0]
    if len(sample) < _LEAST:
        return None
    sample = sample[:: -(-len(sample) // _SAMPLES)]
    seen, behind = (
        pixels.reshape(-1, 3)[sample].astype(np.float32) for pixels in (image, plate.color)
    )
    gain = _gain(seen, behind)
    squared = _squared(seen - behind * gain)
    noise = float(np.sqrt(np.median(squared) / _CHI_SQUARED_MEDIAN))
    if noise > settings.unsteady:
        return None
    behind = plate.color * gain
    variance = _variance(plate.deviation, noise, settings)
    light, strain = _shadows(image, behind, variance, settings.shade)
    if contact is not None and contact.any():
        part = _surrounding(contact, settings.contact.window)
        darker, less = _shadows(image[part], behind[part], variance[part], settings.contact)
        better = contact[part] & (less < strain[part])
        light[part][better], strain[part][better] = darker[better], less[better]
    return Lighting(gain, noise, light, strain)


def _shadows(image: Plane, behind: Plane, variance: Plane, shade: Shade) -> tuple[Plane, Plane]:
    """Light that changes slowly over the image, and how little it explains (see ``Lighting``)."""
    image, behind = np.ascontiguousarray(image), np.ascontiguousarray(behind)
    light = np.empty_like(image)
    _background_numba.relight(
        _mean(image * behind, shade.window),
        _mean(behind * behind, shade.window),
        (shade.darkest, shade.brightest, shade.tint),
        light,
    )
    variance = variance + np.float32(shade.slope**2)
    departure = np.empty_like(variance)
    _background_numba.depart(image, behind, light, variance, departure)
    # three is what noise alone gives
    strain = np.float32(shade.texture) * np.maximum(
        _mean(departure, shade.window) - np.float32(3), 0
    )
    best, least = np.empty_like(light), np.empty_like(strain)
    _background_numba.best_shade(
        image, behind, light, strain, variance, shade.window // 2, best, least
    )
    return best, least


def _surrounding(chosen: Mask, window: int) -> Box:
    """The box of chosen pixels (h, w), and of their neighbourhoods' neighbourhoods."""
    rows, columns = (
        slice(max(int(found[0]) - window, 0), int(found[-1]) + window + 1)
        for found in (np.nonzero(chosen.any(axis))[0] for axis in (1, 0))
    )
    return rows, columns


def background_density(
    image: Plane, chosen: Mask, plate: Plate, lighting: Lighting, settings: PlateSettings
) -> Plane:
    """Log density of colours of an image (h, w, 3) where they are ``chosen``, (n,).

    If they show the plate, lit as the surroundings are, or as ``lighting.light`` says.
    """
    shape = plate.known.shape
    require_shape(chosen, "chosen", shape, "(h, w) of the plate's part")
    for name, colors in (("image", image), ("light", lighting.light)):
        require_shape(colors, name, (*shape, 3), "(h, w, 3) of the plate's part")
    places = np.flatnonzero(chosen)
    density = np.empty(len(places), np.float32)
    weights = 1 - settings.shadow_prior - settings.clutter, settings.shadow_prior
    flat = (plane.reshape(-1, 3) for plane in (image, plate.color))
    _background_numba.log_density(
        places,
        *flat,
        plate.deviation.reshape(-1),
        lighting.gain,
        lighting.light.reshape(-1, 3),
        lighting.strain.reshape(-1),
        (max(lighting.noise, settings.noise) ** 2, settings.shadow_noise**2),
        (float(np.log(weights[0])), float(np.log(weights[1]))),
        density,
    )
    return density


def _variance(deviation: Plane, noise: float, settings: PlateSettings) -> Plane:
    variance: Plane = deviation**2 + np.float32(max(noise, settings.noise) ** 2)
    return variance


def _mean(plane: Plane, window: int) -> Plane:
    mean: Plane = cv2.boxFilter(plane, -1, (window, window), borderType=cv2.BORDER_REPLICATE)
    return mean


def _squared(difference: Plane) -> Plane:
    squared: Plane = np.einsum("...c,...c->...", difference, difference)
    return squared


def _gain(image: Plane, behind: Plane) -> Plane:
    """Exposure of the image relative to the plate, by channel (3,)."""
    gains = np.ones(3, np.float32)
    for channel in range(3):
        bright = behind[:, channel] > _DARK
        if int(bright.sum()) >= 100:
            gains[channel] = np.median(image[bright, channel] / behind[bright, channel])
    return gains
