"""Neighbours of a field with several labels, and one expansion as a min-cut, as compiled loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

# forward half of the eight directions; direction 4 + k, its reverse is 3 - k
_ROWS = (0, 1, 1, 1)
_COLUMNS = (1, -1, 0, 1)
_NEARNESS = (1.0, 0.7071067811865476, 1.0, 0.7071067811865476)  # over the distance


@kernel()
def mean_contrast(open_: NDArray[np.bool_], image: NDArray[np.float32]) -> float:
    """Mean squared colour difference of neighbours of which one at least is open."""
    height, width = open_.shape
    total, count = 0.0, 0
    for row in range(height):
        for column in range(width):
            for k in range(4):
                r, c = row + _ROWS[k], column + _COLUMNS[k]
                if r >= height or c < 0 or c >= width:
                    continue
                if open_[row, column] or open_[r, c]:
                    total += _squared(image, row, column, r, c)
                    count += 1
    return total / max(count, 1)


@kernel()
def link(
    open_: NDArray[np.bool_],
    image: NDArray[np.float32],
    weights: tuple[float, float, float],
    unit: float,
    links: NDArray[np.int32],
) -> None:
    """Price of different labels of neighbours.

    Args:
        open_: (H, W), pixels whose label is sought.
        image: (H, W, 3) colours.
        weights: nats of the contrast term and of the Potts term, and 1 / (2 mean contrast).
        unit: price of a nat.
        links: (H, W, 4), written, preset to 0.
    """
    height, width = open_.shape
    for row in range(height):
        for column in range(width):
            for k in range(4):
                r, c = row + _ROWS[k], column + _COLUMNS[k]
                if r >= height or c < 0 or c >= width:
                    continue
                if not (open_[row, column] or open_[r, c]):
                    continue
                value = weights[0] * np.exp(-weights[2] * _squared(image, row, column, r, c))
                links[row, column, k] = np.int32(round((value + weights[1]) * unit * _NEARNESS[k]))


@kernel()
def expand(
    labels: NDArray[np.uint8],
    price: NDArray[np.int32],
    links: NDArray[np.int32],
    label: int,
    node: NDArray[np.int32],
    neighbor: NDArray[np.int32],
    capacity: NDArray[np.int32],
    excess: NDArray[np.int32],
) -> None:
    """The cut that lets pixels change to one label, where the source's side changes.

    Args:
        labels: (H, W) as they are.
        price: (L, H, W) of each label at each pixel.
        links: (H, W, 4) of ``link``.
        label: what pixels may change to.
        node: (H, W), number of each open pixel that has another label, -1 elsewhere.
        neighbor: (n, 8), written, preset to -1.
        capacity: (n, 8), written, preset to 0.
        excess: (n,), written, preset to 0.
    """
    height, width = labels.shape
    for row in range(height):
        for column in range(width):
            i = node[row, column]
            if i >= 0:
                own = price[labels[row, column], row, column]
                excess[i] += own - price[label, row, column]
            for k in range(4):
                r, c = row + _ROWS[k], column + _COLUMNS[k]
                if r >= height or c < 0 or c >= width:
                    continue
                j, flow = node[r, c], links[row, column, k]
                if (i < 0 and j < 0) or flow == 0:
                    continue
                one, other = labels[row, column], labels[r, c]
                if i >= 0 and j >= 0:
                    neighbor[i, 4 + k], neighbor[j, 3 - k] = j, i
                    if one == other:
                        capacity[i, 4 + k] = flow
                        capacity[j, 3 - k] = flow
                    else:  # paid now, unless both change
                        excess[j] += flow
                        capacity[j, 3 - k] = flow
                elif i >= 0:
                    excess[i] += _relief(one, other, label, flow)
                else:
                    excess[j] += _relief(other, one, label, flow)


@kernel()
def energy(labels: NDArray[np.uint8], price: NDArray[np.int32], links: NDArray[np.int32]) -> int:
    """What labels (H, W) cost."""
    height, width = labels.shape
    total = 0
    for row in range(height):
        for column in range(width):
            total += price[labels[row, column], row, column]
            for k in range(4):
                r, c = row + _ROWS[k], column + _COLUMNS[k]
                if r < height and 0 <= c < width and labels[row, column] != labels[r, c]:
                    total += links[row, column, k]
    return total


@inner()
def _relief(own, fixed, label, flow):  # type: ignore[no-untyped-def]
    """What a pixel that changes saves beside one that keeps its label."""
    return np.int32((own != fixed) - (label != fixed)) * flow


@inner()
def _squared(image, row, column, r, c):  # type: ignore[no-untyped-def]
    x = image[row, column, 0] - image[r, c, 0]
    y = image[row, column, 1] - image[r, c, 1]
    z = image[row, column, 2] - image[r, c, 2]
    return x * x + y * y + z * z
