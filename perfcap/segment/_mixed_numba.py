"""Pixels that are partly person and partly background, as a compiled loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel


@kernel()
def settle(
    pixels: NDArray[np.int64],
    image: NDArray[np.uint8],
    plate: NDArray[np.uint8],
    gain: NDArray[np.float32],
    known: NDArray[np.bool_],
    side: NDArray[np.int8],
    limits: tuple[int, float, float, float],
    mask: NDArray[np.bool_],
) -> None:
    """Give pixels to the side whose colour they have more of.

    Args:
        pixels: rows and columns, (n, 2).
        image: (H, W, 3).
        plate: (H, W, 3).
        gain: of the camera's exposure over the plate's, (3,).
        known: where there is a plate, (H, W).
        side: 1 where a pixel is purely inside, -1 purely outside, 0 on the boundary, (H, W).
        limits: px within which pure colours are looked for; squared colour difference below which
            two sides cannot be told apart; by how much a share must differ from a half; and by
            how much it may leave [0, 1].
        mask: (H, W), changed.
    """
    sums = np.empty((3, 4))  # colours inside, outside, and of the plate there; weights
    for i in range(len(pixels)):
        row, column = pixels[i, 0], pixels[i, 1]
        if not known[row, column]:
            continue
        _gather(image, plate, gain, known, side, row, column, limits[0], sums)
        if sums[0, 3] == 0.0 or sums[1, 3] == 0.0 or sums[2, 3] == 0.0:
            continue
        along, square = 0.0, 0.0
        for k in range(3):
            # the pixel's own background, lit as its surroundings are
            light = (sums[1, k] / sums[1, 3] + 1) / (sums[2, k] / sums[2, 3] + 1)
            behind = np.float32(plate[row, column, k]) * gain[k]
            outside = behind * min(max(light, 0.3), 2.0)
            step = sums[0, k] / sums[0, 3] - outside
            along += step * (image[row, column, k] - outside)
            square += step * step
        if square > limits[1] and limits[2] < abs(along / square - 0.5) < 0.5 + limits[3]:
            mask[row, column] = along > 0.5 * square


@inner()
def _gather(image, plate, gain, known, side, row, column, reach, sums):  # type: ignore[no-untyped-def]
    """Sums of pure colours around a pixel, nearer ones weighing more."""
    height, width = side.shape
    sums[:] = 0.0
    for r in range(max(row - reach, 0), min(row + reach + 1, height)):
        for c in range(max(column - reach, 0), min(column + reach + 1, width)):
            weight = 1.0 / (1.0 + (r - row) ** 2 + (c - column) ** 2)
            if side[r, c] > 0:
                for k in range(3):
                    sums[0, k] += weight * image[r, c, k]
                sums[0, 3] += weight
            elif side[r, c] < 0 and known[r, c]:
                for k in range(3):
                    sums[1, k] += weight * image[r, c, k]
                    sums[2, k] += weight * (np.float32(plate[r, c, k]) * gain[k])
                sums[1, 3] += weight
                sums[2, 3] += weight
