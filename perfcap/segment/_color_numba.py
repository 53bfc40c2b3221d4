"""Mixtures of Gaussians over colours, as compiled loops."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

_NEGLIGIBLE = 16.0  # nats below the largest component: less than float32 resolves


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
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
    terms = np.empty(count, np.float32)
    for i in range(len(pixels)):
        best = np.float32(-np.inf)
        for k in range(count):  # views of rows would cost more than the component
            a, b, c = (
                pixels[i, 0] - means[k, 0],
                pixels[i, 1] - means[k, 1],
                pixels[i, 2] - means[k, 2],
            )
            x = whitening[k, 0, 0] * a
            y = whitening[k, 1, 0] * a + whitening[k, 1, 1] * b
            z = whitening[k, 2, 0] * a + whitening[k, 2, 1] * b + whitening[k, 2, 2] * c
            value = offset[k] - np.float32(0.5) * (x * x + y * y + z * z)
            terms[k] = value
            best = max(best, value)
        total = np.float32(0.0)
        for k in range(count):
            if terms[k] > best - _NEGLIGIBLE:
                total += np.exp(terms[k] - best)
        out[i] = best + np.log(total)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
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


@numba.njit(nogil=True, cache=True)
def _component(pixel, mean, whitening, offset):  # type: ignore[no-untyped-def]
    a, b, c = pixel[0] - mean[0], pixel[1] - mean[1], pixel[2] - mean[2]
    x = whitening[0, 0] * a
    y = whitening[1, 0] * a + whitening[1, 1] * b
    z = whitening[2, 0] * a + whitening[2, 1] * b + whitening[2, 2] * c
    return offset - np.float32(0.5) * (x * x + y * y + z * z)
