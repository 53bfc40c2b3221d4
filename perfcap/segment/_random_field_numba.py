"""Pixels of the uncertain band to the nodes of a min-cut, as compiled loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

_LISTED = 2048  # squared differences of colours, whose exponentials are computed once

# forward half of the eight directions; direction 4 + k, its reverse is 3 - k
_ROWS = (0, 1, 1, 1)
_COLUMNS = (1, -1, 0, 1)
_NEARNESS = (1.0, 0.7071067811865476, 1.0, 0.7071067811865476)  # over the distance


@kernel()
def mean_contrast(labels: NDArray[np.uint8], image: NDArray[np.float32]) -> float:
    """Mean squared colour difference of neighbours of which one at least is uncertain."""
    height, width = labels.shape
    total, count = 0.0, 0
    for row in range(height):
        for column in range(width):
            for k in range(4):
                r, c = row + _ROWS[k], column + _COLUMNS[k]
                if r >= height or c < 0 or c >= width:
                    continue
                if labels[row, column] >= 2 or labels[r, c] >= 2:
                    total += _squared(image, row, column, r, c)
                    count += 1
    return total / max(count, 1)


@kernel()
def connect(
    labels: NDArray[np.uint8],
    image: NDArray[np.float32],
    calm: NDArray[np.float32],
    weights: tuple[float, float, float],
    unit: float,
    node: NDArray[np.int32],
    neighbor: NDArray[np.int32],
    capacity: NDArray[np.int32],
    excess: NDArray[np.int32],
) -> None:
    """Fill neighbours and capacities of the band's nodes, and what decided neighbours say.

    Args:
        labels: (H, W), 0 background, 1 foreground, above: uncertain.
        image: (H, W, 3) colours.
        calm: (H, W) exp(-m^2) of the temporal gradient m over its scale, or of no rows.
        weights: nats of the contrast term and of the temporal term, and 1 / (2 mean contrast).
        unit: capacity of a nat.
        node: (H, W), number of each uncertain pixel.
        neighbor: (n, 8), written, preset to -1.
        capacity: (n, 8), written, preset to 0.
        excess: (n,), written, preset to 0.
    """
    height, width = labels.shape
    contrast, temporal, narrow = weights
    likeness = np.exp(-narrow * np.arange(_LISTED))  # images of bytes differ by whole numbers
    for row in range(height):
        for column in range(width):
            one, i = labels[row, column], node[row, column]
            for k in range(4):  # written out: calls that pass so many arrays cost twice the work
                r, c = row + _ROWS[k], column + _COLUMNS[k]
                if r >= height or c < 0 or c >= width:
                    continue
                other = labels[r, c]
                if one < 2 and other < 2:
                    continue
                x = image[row, column, 0] - image[r, c, 0]
                y = image[row, column, 1] - image[r, c, 1]
                z = image[row, column, 2] - image[r, c, 2]
                apart = x * x + y * y + z * z
                whole = np.int64(min(apart, np.float32(_LISTED)))
                if whole < _LISTED and whole == apart:
                    value = contrast * likeness[whole]
                else:
                    value = contrast * np.exp(-narrow * apart)
                if len(calm):
                    value += temporal * min(calm[row, column], calm[r, c])
                flow = np.int32(round(value * unit * _NEARNESS[k]))
                if one >= 2 and other >= 2:
                    j = node[r, c]
                    neighbor[i, 4 + k], capacity[i, 4 + k] = j, flow
                    neighbor[j, 3 - k], capacity[j, 3 - k] = i, flow
                elif one >= 2:  # an edge to a decided pixel pulls towards that pixel's label
                    excess[i] += flow if other == 1 else -flow
                else:
                    excess[node[r, c]] += flow if one == 1 else -flow


@inner()
def _squared(image, row, column, r, c):  # type: ignore[no-untyped-def]
    x = image[row, column, 0] - image[r, c, 0]
    y = image[row, column, 1] - image[r, c, 1]
    z = image[row, column, 2] - image[r, c, 2]
    return x * x + y * y + z * z
