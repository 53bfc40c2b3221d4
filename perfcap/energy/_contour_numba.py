"""The contour energy of an image, pixel by pixel; the plain-torch twin is ``_contour_torch.py``."""

import math

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_FAINT = 1e-12  # optical depth of pixels that show the background alone


@numba.njit(nogil=True, cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def contour(
    depth: Floats,
    slope: Floats,
    edges: NDArray[np.float32],
    flat: NDArray[np.float32],
    bend: float,
    curved: Floats,
) -> float:
    """Value and derivatives of the contour energy.

    Args:
        depth: optical depth, (H, W); overwritten by the energy's derivative in it.
        slope: minus its derivative, (2, H, W); likewise.
        edges: cosine and sine of twice the direction of image gradients, times their strength,
            (2, H, W).
        flat: price of a unit of contour, (H, W).
        bend: curvature of a unit of strength, px^-2.
        curved: entries xx, xy, yy of the curvature for a shift of the contour, over the optical
            depth, (3, H, W), written.

    Returns:
        The sum over pixels of ``|grad B| (flat - edges . (cos, sin) of twice its direction)``.
    """
    height, width = depth.shape
    total = 0.0
    for row in range(height):
        for column in range(width):
            thick = depth[row, column]
            gx, gy = slope[0, row, column], slope[1, row, column]
            size = math.sqrt(gx * gx + gy * gy)
            if thick < _FAINT or size < 1e-12:
                depth[row, column] = slope[0, row, column] = slope[1, row, column] = 0.0
                curved[0, row, column] = curved[1, row, column] = curved[2, row, column] = 0.0
                continue
            left = math.exp(-thick)
            x, y = gx / size, gy / size
            c, s = edges[0, row, column], edges[1, row, column]
            price = flat[row, column]
            alike = c * (x * x - y * y) + 2 * s * x * y
            energy = left * size * (price - alike)
            total += energy
            depth[row, column] = -energy
            slope[0, row, column] = left * ((price + alike) * x - 2 * (c * x + s * y))
            slope[1, row, column] = left * ((price + alike) * y - 2 * (s * x - c * y))
            stiff = left * size * bend * (math.sqrt(c * c + s * s) + abs(price)) / thick
            curved[0, row, column] = stiff * x * x
            curved[1, row, column] = stiff * x * y
            curved[2, row, column] = stiff * y * y
    return total
