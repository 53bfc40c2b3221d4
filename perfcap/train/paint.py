"""Colours and patterns of skin, hair and cloth."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Rgb = tuple[float, float, float]

PATTERNS = ("plain", "stripes", "checks", "dots", "blotches")
_SHARES = (0.42, 0.24, 0.1, 0.08, 0.16)
_PALEST, _DARKEST = np.array([244.0, 208.0, 182.0]), np.array([74.0, 46.0, 34.0])


@dataclass(frozen=True)
class Paint:
    """How a surface is coloured.

    Attributes:
        color: sRGB, 0 to 255.
        pattern: one of ``PATTERNS``.
        second: colour of the pattern.
        direction: across stripes, unit (3,).
        period: of the pattern, m.
        grain: deviation of fine unevenness, of 255.
    """

    color: Rgb
    pattern: str = "plain"
    second: Rgb = (0.0, 0.0, 0.0)
    direction: Rgb = (0.0, 1.0, 0.0)
    period: float = 0.1
    grain: float = 4.0

    def at(self, places: Floats, rng: np.random.Generator) -> Floats:
        """Colours (N, 3), 0 to 255, of places (N, 3), metres."""
        share = self._share(places, rng)[:, None]
        color = (1 - share) * np.array(self.color) + share * np.array(self.second)
        color = color + self.grain * rng.normal(size=(len(places), 1))
        return np.asarray(color, np.float32)

    def _share(self, places: Floats, rng: np.random.Generator) -> Floats:
        if self.pattern == "plain":
            return np.zeros(len(places), np.float32)
        phase = places * (2 * np.pi / self.period)
        if self.pattern == "stripes":
            wave = np.sin(phase @ np.array(self.direction, np.float32))
        elif self.pattern == "checks":
            wave = np.sin(phase[:, 0]) * np.sin(phase[:, 1])
        elif self.pattern == "dots":
            wave = np.sin(phase).prod(1) - 0.3
        else:
            wave = np.zeros(len(places))
            for octave in (0.35, 0.8, 1.9):
                turn = rng.normal(size=(3, 3)) * octave
                wave = wave + np.sin(phase @ turn + rng.uniform(0, 6.3, 3)).sum(1) / 3
        return np.asarray((0.5 + 4 * wave).clip(0, 1), np.float32)


def random_paint(rng: np.random.Generator, color: Rgb) -> Paint:
    """A pattern over a colour."""
    pattern = str(rng.choice(PATTERNS, p=_SHARES))
    direction = np.array([0.0, 1.0, 0.0])
    if rng.random() < 0.35:
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
    return Paint(
        color,
        pattern,
        cloth_color(rng),
        (float(direction[0]), float(direction[1]), float(direction[2])),
        float(np.exp(rng.uniform(np.log(0.03), np.log(0.25)))),
        float(rng.uniform(0, 10)),
    )


def cloth_color(rng: np.random.Generator) -> Rgb:
    """Any colour; greys, whites, blacks and denim more often."""
    if rng.random() < 0.35:
        grey = rng.uniform(15, 250)
        tint = rng.normal(0, 6, 3)
        return _clipped(grey + tint)
    saturation = rng.beta(1.5, 1.8)
    value = rng.uniform(0.15, 1.0)
    hue = rng.choice([rng.random(), rng.uniform(0.56, 0.68)], p=[0.75, 0.25])
    return _clipped(255 * np.array(colorsys.hsv_to_rgb(float(hue), float(saturation), value)))


def skin_color(rng: np.random.Generator) -> Rgb:
    """From pale to dark, a little redder or yellower."""
    share = rng.beta(1.1, 1.4)
    return _clipped(_PALEST + share * (_DARKEST - _PALEST) + rng.normal(0, 6, 3))


def hair_color(rng: np.random.Generator) -> Rgb:
    """Black, brown, fair, grey; rarely dyed."""
    if rng.random() < 0.06:
        return cloth_color(rng)
    tones = np.array([[22, 18, 16], [58, 40, 30], [110, 74, 44], [190, 150, 95], [165, 160, 155]])
    tone = tones[rng.choice(5, p=[0.35, 0.3, 0.15, 0.12, 0.08])]
    return _clipped(tone * rng.uniform(0.8, 1.2) + rng.normal(0, 5, 3))


def _clipped(color: NDArray[np.float64]) -> Rgb:
    red, green, blue = (float(v) for v in color.clip(0, 255))
    return red, green, blue
