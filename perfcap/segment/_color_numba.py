"""Mixtures of Gaussians over colours, as compiled loops."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

_CHUNK = 128  # pixels whose terms stay in the cache
_NEGLIGIBLE = 16.0  # nats below the largest component: less than float32 resolves


@kernel()
def log_density(
    pixels: NDArray[np.float32],
    means: NDArray[np.float32],
    whitening: NDArray[np.float32],
    offset: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Log density of a mixture at pixels (n, 3), written to ``out`` (n,).

    Args:
        pixels: colours.
        means: (K, 3).
        whitening: (K, 3, 3) lower triangular, distances are |whitening (x - mean)|.
        offset: (K,) log of weight and normalisation.
        out: written.
    """
    count = len(means)
    terms, best = np.empty((count, _CHUNK), np.float32), np.empty(_CHUNK, np.float32)
    colors = np.zeros((3, _CHUNK), np.float32)
    zero, half, one = np.float32(0), np.float32(0.5), np.float32(1)
    for start in range(0, len(pixels), _CHUNK):
        size = min(_CHUNK, len(pixels) - start)
        for i in range(size):
            for channel in range(3):
                colors[channel, i] = pixels[start + i, channel]
        best[:] = np.float32(-np.inf)
        for k in range(count):  # a component at a time: the processor takes many pixels at once
            red, green, blue = means[k, 0], means[k, 1], means[k, 2]
            by_red, by_red_2, by_red_3 = whitening[k, 0, 0], whitening[k, 1, 0], whitening[k, 2, 0]
            by_green, by_green_2 = whitening[k, 1, 1], whitening[k, 2, 1]
            by_blue, most = whitening[k, 2, 2], offset[k]
            for i in range(_CHUNK):
                a, b, c = colors[0, i] - red, colors[1, i] - green, colors[2, i] - blue
                x = by_red * a
                y = by_red_2 * a + by_green * b
                z = by_red_3 * a + by_green_2 * b + by_blue * c
                value = most - half * (x * x + y * y + z * z)
                terms[k, i] = value
                best[i] = value if value > best[i] else best[i]
        for i in range(size):
            total, several = zero, False
            for k in range(count):
                below = terms[k, i] - best[i]
                if below == zero:  # the exponential is one, and the logarithm of one nothing
                    several |= bool(total > zero)
                    total += one
                elif terms[k, i] > best[i] - _NEGLIGIBLE:
                    several = True
                    total += np.exp(below)
            out[start + i] = best[i] + np.log(total) if several else best[i]


@kernel()
def gather(
    pixels: NDArray[np.float32],
    means: NDArray[np.float32],
    whitening: NDArray[np.float32],
    offset: NDArray[np.float32],
    moments: NDArray[np.float64],
) -> None:
    """Add each pixel to the moments (K, 10) of the component that explains it best.

    Moments are count, sum of colours (3), and sums of products (6: rr, rg, rb, gg, gb, bb).
    """
    count = len(means)
    for i in range(len(pixels)):
        best, winner = np.float32(-np.inf), 0
        for k in range(count):
            value = _component(pixels[i], means[k], whitening[k], offset[k])
            if value > best:
                best, winner = value, k
        red, green, blue = np.float64(pixels[i, 0]), pixels[i, 1], pixels[i, 2]
        row = moments[winner]
        row[0] += 1
        row[1] += red
        row[2] += green
        row[3] += blue
        row[4] += red * red
        row[5] += red * green
        row[6] += red * blue
        row[7] += np.float64(green) * green
        row[8] += np.float64(green) * blue
        row[9] += np.float64(blue) * blue


@inner()
def _component(pixel, mean, whitening, offset):  # type: ignore[no-untyped-def]
    a, b, c = pixel[0] - mean[0], pixel[1] - mean[1], pixel[2] - mean[2]
    x = whitening[0, 0] * a
    y = whitening[1, 0] * a + whitening[1, 1] * b
    z = whitening[2, 0] * a + whitening[2, 1] * b + whitening[2, 2] * c
    return offset - np.float32(0.5) * (x * x + y * y + z * z)


@kernel()
def weigh(
    person: NDArray[np.float32],
    scene: NDArray[np.float32],
    known: NDArray[np.bool_],
    backed: NDArray[np.float32],
    alone_odds: NDArray[np.float32],
    known_odds: NDArray[np.float32],
    scene_odds: NDArray[np.float32],
    clutter: NDArray[np.float32],
    limit: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Nats in favour of the person, (n,), written to ``out``.

    Args:
        person: log density of each colour if it is the person's, (n,).
        scene: and if it is one of the surroundings.
        known: whether there is a plate, (n,); or of no length.
        backed: log density if the colour is the plate's, (n,); likewise.
        alone_odds: (2,) logs of the probability that the person's colour is as expected, and of
            that of any colour; where there is no plate.
        known_odds: the same where there is one.
        scene_odds: the same of the surroundings.
        clutter: (1,) log probability that what is before the plate hides it.
        limit: (1,) most nats either way.
        out: written.
    """
    for i in range(len(person)):
        seen = len(known) > 0 and known[i]
        odds = known_odds if seen else alone_odds
        own = _either(person[i] + odds[0], odds[1])
        other = _either(scene[i] + scene_odds[0], scene_odds[1])
        if seen:
            other = _either(backed[i], other + clutter[0])
        out[i] = min(max(own - other, -limit[0]), limit[0])


@inner()
def _either(one, other):  # type: ignore[no-untyped-def]
    """Logarithm of a sum, of logarithms of its parts; in float32, as ``np.logaddexp``."""
    if one == other:
        return one + np.float32(0.6931471805599453)
    high, low = max(one, other), min(one, other)
    apart = low - high
    if apart < np.float32(-20) and abs(high) > np.float32(1):
        return high  # what is added is less than its last bit
    return high + np.float32(math.log1p(math.exp(apart)))
