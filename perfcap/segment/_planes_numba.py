"""Where pixels of a frame are in another one, plane by plane, as a compiled loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import kernel


@kernel()
def coordinates(
    matrices: NDArray[np.float64],
    known: NDArray[np.bool_],
    planes: NDArray[np.uint8],
    scale: float,
    corner: tuple[int, int],
    at: NDArray[np.float32],
) -> None:
    """Homographies of shrunk pixels, applied to whole ones.

    Args:
        matrices: of each plane, (n, 3, 3).
        known: which of them are, (n,).
        planes: of each shrunk pixel, (h', w').
        scale: shrunk pixels a pixel.
        corner: row and column of the first pixel.
        at: column and row in the other frame, (h, w, 2), written; far outside where unknown.
    """
    rows, columns = planes.shape
    for i in range(at.shape[0]):
        y = (i + corner[0] + 0.5) * scale - 0.5
        row = min(max(int(y + 0.5), 0), rows - 1)
        for j in range(at.shape[1]):
            x = (j + corner[1] + 0.5) * scale - 0.5
            plane = planes[row, min(max(int(x + 0.5), 0), columns - 1)]
            at[i, j] = -1e4
            if known[plane]:
                m = matrices[plane]
                w = m[2, 0] * x + m[2, 1] * y + m[2, 2]
                if w > 1e-6:
                    u = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / w
                    v = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / w
                    if abs(u) < 1e5 and abs(v) < 1e5:  # remap holds no more
                        at[i, j, 0] = (u + 0.5) / scale - 0.5
                        at[i, j, 1] = (v + 0.5) / scale - 0.5
