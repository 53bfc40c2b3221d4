"""How far inward another part begins, as a compiled loop; tests hold it equal to numpy's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import kernel


@kernel()
def look_inward(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    parts: NDArray[np.integer],
    of_triangle: NDArray[np.int64],
    steps: NDArray[np.float64],
    corner: tuple[int, int],
    found: NDArray[np.float64],
) -> None:
    """Write the step at which another part begins, infinite where none does, to ``found`` (P,).

    Args:
        points: (P, 2) px.
        normals: outward, (P, 2).
        parts: which part each pixel sees, (H, W), negative where none; or which triangle.
        of_triangle: which part a triangle belongs to, (T,); of no length where parts are known.
        steps: px inward, increasing, (S,).
        corner: row and column in the image of the first pixel of ``parts``.
        found: written.
    """
    for point in range(len(points)):
        own = np.int64(-1)
        found[point] = np.inf
        for number in range(len(steps)):
            step = steps[number]
            column = np.int64(np.rint(points[point, 0] - step * normals[point, 0])) - corner[1]
            row = np.int64(np.rint(points[point, 1] - step * normals[point, 1])) - corner[0]
            seen = np.int64(-1)
            if 0 <= row < parts.shape[0] and 0 <= column < parts.shape[1]:
                seen = np.int64(parts[row, column])
                if seen >= 0 and len(of_triangle) > 0:
                    seen = of_triangle[seen]
            if number == 0:
                own = seen
                if own < 0:
                    break
            elif seen != own:
                if seen >= 0:
                    found[point] = step
                break
