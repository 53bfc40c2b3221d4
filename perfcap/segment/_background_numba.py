"""Medians over the frames in which a pixel shows background, as a compiled loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

_NEGLIGIBLE = -40.0  # nats below the other case: nothing in the last bit
_CHUNK = 1024  # pixels sorted side by side: their images stay in the cache


def masked_median(
    images: NDArray[np.uint8],
    hidden: NDArray[np.bool_],
    color: NDArray[np.uint8],
    spread: NDArray[np.float32],
    seen: NDArray[np.uint8],
) -> None:
    """Median colour and spread of every pixel over the images in which it is not hidden.

    Args:
        images: (n, H, W, 3), n at most 255.
        hidden: (n, H, W).
        color: (H, W, 3), written: lower medians.
        spread: (H, W), written: mean over channels of the interquartile range.
        seen: (H, W), written: in how many images.
    """
    flat = images.reshape(len(images), -1), hidden.reshape(len(images), -1)
    network = np.array(_comparators(len(images)), np.int64).reshape(-1, 2)
    _masked_median(*flat, network, color.reshape(-1, 3), spread.reshape(-1), seen.reshape(-1))


@kernel()
def squared_slope(color: NDArray[np.uint8], slope: NDArray[np.float32]) -> None:
    """Squared slope of an image, grey levels a pixel, the mean over channels (Sobel's filters).

    Args:
        color: (H + 2, W + 2, 3), with a pixel more on each side.
        slope: (H, W), written.
    """
    for row in range(slope.shape[0]):
        for column in range(slope.shape[1]):
            total = np.int32(0)
            for k in range(3):
                across, down = np.int32(0), np.int32(0)
                for step in range(3):
                    weight = np.int32(2 if step == 1 else 1)
                    across += weight * (
                        np.int32(color[row + step, column + 2, k]) - color[row + step, column, k]
                    )
                    down += weight * (
                        np.int32(color[row + 2, column + step, k]) - color[row, column + step, k]
                    )
                total += np.int32(across * across + down * down)
            slope[row, column] = np.float32(total) / np.float32(64) / np.float32(3)


def _comparators(count: int) -> list[tuple[int, int]]:
    """Batcher's merge exchange (Knuth, The Art of Computer Programming, 5.2.2, algorithm M).

    Pairs of places to compare, in an order that sorts any ``count`` numbers.
    """
    pairs = []
    top = 1 << max(count - 1, 0).bit_length() >> 1
    p = top
    while p > 0:
        q, r, d = top, 0, p
        while True:
            pairs += [(i, i + d) for i in range(count - d) if i & p == r]
            if q == p:
                break
            q, r, d = q >> 1, p, q - p
        p >>= 1
    return pairs


@kernel()
def _masked_median(
    images: NDArray[np.uint8],
    hidden: NDArray[np.bool_],
    network: NDArray[np.int64],
    color: NDArray[np.uint8],
    spread: NDArray[np.float32],
    seen: NDArray[np.uint8],
) -> None:
    """The same of pixels in a row, some of them at a time.

    Neighbours are sorted side by side, by steps that are the same for all of them: minima and
    maxima of whole rows of bytes, which the processor takes many at a time.
    """
    frames, pixels = hidden.shape
    values = np.empty((frames, 3 * _CHUNK), np.uint8)
    for start in range(0, pixels, _CHUNK):
        size = min(_CHUNK, pixels - start)
        for frame in range(frames):
            for i in range(size):
                for channel in range(3):
                    value = images[frame, 3 * (start + i) + channel]
                    # hidden ones come last, and are not counted
                    values[frame, 3 * i + channel] = 255 if hidden[frame, start + i] else value
        for step in range(len(network)):
            low, high = values[network[step, 0]], values[network[step, 1]]
            for i in range(3 * size):
                one, other = low[i], high[i]
                low[i], high[i] = min(one, other), max(one, other)
        for i in range(size):
            count = 0
            for frame in range(frames):
                count += not hidden[frame, start + i]
            seen[start + i] = count
            if count > 0:
                part = values[:, 3 * i : 3 * i + 3]
                spread[start + i] = _quantiles(part, count, color[start + i])


@inner()
def _quantiles(values, count, color):  # type: ignore[no-untyped-def]
    """Write the median of the first ``count`` sorted rows (n, 3); return the mean spread."""
    total = 0.0
    for channel in range(3):
        color[channel] = values[(count - 1) // 2, channel]
        total += float(values[(3 * count) // 4, channel])
        total -= float(values[count // 4, channel])
    return total / 3


@kernel(error_model="numpy")
def relight(
    cross: NDArray[np.float32],
    power: NDArray[np.float32],
    limits: tuple[float, float, float],
    light: NDArray[np.float32],
) -> None:
    """Least-squares light on a neighbourhood of the plate, by channel, (H, W, 3), written.

    Args:
        cross: neighbourhood means of image times plate, (H, W, 3).
        power: of the plate squared, (H, W, 3).
        limits: least and greatest light, and how much one channel may differ from all.
        light: written.
    """
    height, width, _ = cross.shape
    darkest, brightest, tint = np.float32(limits[0]), np.float32(limits[1]), np.float32(limits[2])
    one = np.float32(1.0)
    for row in range(height):
        for column in range(width):
            top = cross[row, column, 0] + cross[row, column, 1] + cross[row, column, 2]
            bottom = power[row, column, 0] + power[row, column, 1] + power[row, column, 2]
            common = min(max(top / (bottom + one), darkest), brightest)
            for channel in range(3):
                own = cross[row, column, channel] / (power[row, column, channel] + one)
                low, high = common * (one - tint), common * (one + tint)
                light[row, column, channel] = min(max(own, low), high)


@kernel(error_model="numpy")
def depart(
    image: NDArray[np.float32],
    behind: NDArray[np.float32],
    light: NDArray[np.float32],
    variance: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Squared deviations of an image from the relit plate, (H, W), written to ``out``."""
    height, width = variance.shape
    for row in range(height):
        for column in range(width):
            out[row, column] = (
                _squared(image, behind, light, row, column, row, column) / variance[row, column]
            )


# NumPy's division: pixels whose divisors are asked for zero cannot go together
@kernel(error_model="numpy")
def best_shade(
    image: NDArray[np.float32],
    behind: NDArray[np.float32],
    light: NDArray[np.float32],
    strain: NDArray[np.float32],
    variance: NDArray[np.float32],
    radius: int,
    best: NDArray[np.float32],
    least: NDArray[np.float32],
) -> None:
    """The neighbourhood, of those that contain a pixel, whose light explains it best.

    Next to the person a pixel's own neighbourhood is half person; one to the side is not.

    Args:
        image: (H, W, 3).
        behind: the plate, (H, W, 3).
        light: on the neighbourhood around each pixel, (H, W, 3).
        strain: nats against that neighbourhood, (H, W).
        variance: (H, W).
        radius: px, by which neighbourhoods to the side are moved.
        best: (H, W, 3), written: its light.
        least: (H, W), written: its strain.
    """
    height, width = variance.shape
    half = np.float32(0.5)
    planes = np.empty((height, 3, width), np.float32)
    own, plate = np.empty((3, width), np.float32), np.empty((3, width), np.float32)
    lowest, chosen = np.empty(width, np.float32), np.empty(width, np.int8)
    for row in range(height):
        _split(light[row], planes[row])
    for row in range(height):
        _split(image[row], own)
        _split(behind[row], plate)
        lowest[:] = np.float32(np.inf)
        chosen[:] = 0
        for side in range(5):
            down, right = _side(side, radius)
            r = row + down
            first, last = max(0, -right), min(width, width - right)
            if r < 0 or r >= height or first >= last:
                continue
            here = slice(first, last)
            there = slice(first + right, last + right)
            red, green, blue = own[0, here], own[1, here], own[2, here]
            red_2, green_2, blue_2 = plate[0, here], plate[1, here], plate[2, here]
            lit = planes[r]
            red_3, green_3, blue_3 = lit[0, there], lit[1, there], lit[2, there]
            wide, against = variance[row, here], strain[r, there]
            low, best_side, this = lowest[here], chosen[here], np.int8(side)
            for i in range(last - first):
                x = red[i] - red_3[i] * red_2[i]
                y = green[i] - green_3[i] * green_2[i]
                z = blue[i] - blue_3[i] * blue_2[i]
                total = half * (x * x + y * y + z * z) / wide[i] + against[i]
                better = total < low[i]
                low[i] = total if better else low[i]
                best_side[i] = this if better else best_side[i]
        for column in range(width):
            down, right = _side(chosen[column], radius)
            r, c = row + down, column + right
            least[row, column] = strain[r, c]
            for channel in range(3):
                best[row, column, channel] = light[r, c, channel]


@inner()
def _split(colors, planes):  # type: ignore[no-untyped-def]
    """A row of colours (W, 3), channels apart (3, W): so the processor takes many at once."""
    for column in range(len(colors)):
        for channel in range(3):
            planes[channel, column] = colors[column, channel]


@inner()
def _side(side, radius):  # type: ignore[no-untyped-def]
    """How far down and to the right a neighbourhood of five is."""
    down = radius if side == 1 else -radius if side == 2 else 0
    right = radius if side == 3 else -radius if side == 4 else 0
    return down, right


@kernel()
def log_density(
    chosen: NDArray[np.int64],
    image: NDArray[np.float32],
    plate: NDArray[np.uint8],
    deviation: NDArray[np.float32],
    gain: NDArray[np.float32],
    light: NDArray[np.float32],
    strain: NDArray[np.float32],
    variances: tuple[float, float],
    weights: tuple[float, float],
    out: NDArray[np.float32],
) -> None:
    """Log density of colours that show the plate, either as it is or relit.

    Args:
        chosen: numbers of the pixels asked for, (n,).
        image: of all pixels, (N, 3).
        plate: (N, 3).
        deviation: of the plate's colours, (N,).
        gain: exposure of the image relative to the plate, (3,).
        light: by which the plate may be relit, (N, 3).
        strain: nats against that, (N,).
        variances: of the image's channels, and what is added where relit.
        weights: logs of the probabilities of the two cases.
        out: (n,), written.
    """
    constant, noise = -1.5 * np.log(2 * np.pi), np.float32(variances[0])
    for i in range(len(chosen)):
        at = chosen[i]
        plain, relit = 0.0, 0.0
        for channel in range(3):
            color = float(image[at, channel])
            behind = float(np.float32(plate[at, channel]) * gain[channel])
            plain += (color - behind) ** 2
            relit += (color - light[at, channel] * behind) ** 2
        variance = deviation[at] * deviation[at] + noise
        spread = variance + variances[1]
        lit = weights[0] - 0.5 * plain / variance - 1.5 * np.log(variance)
        shaded = weights[1] - 0.5 * relit / spread - strain[at] - 1.5 * np.log(spread)
        high, low = max(lit, shaded), min(lit, shaded)
        out[i] = constant + high
        if low - high > _NEGLIGIBLE:
            out[i] = constant + high + np.log1p(np.exp(low - high))


@inner()
def _squared(image, behind, light, row, column, r, c):  # type: ignore[no-untyped-def]
    x = image[row, column, 0] - light[r, c, 0] * behind[row, column, 0]
    y = image[row, column, 1] - light[r, c, 1] * behind[row, column, 1]
    z = image[row, column, 2] - light[r, c, 2] * behind[row, column, 2]
    return x * x + y * y + z * z
