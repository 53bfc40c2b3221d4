"""Hard z-buffer on the CPU: one pass over triangles, one pass over the pixels of each.

The plain-torch twin in ``_zbuffer_reference.py`` states the same thing without loops; tests hold
the two equal. Arithmetic on the pixel grid is in integers, so coverage is exact.
"""

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def fill(
    grid: NDArray[np.int64],
    inverse_depth: NDArray[np.float64],
    usable: NDArray[np.bool_],
    faces: NDArray[np.int64],
    culled_sign: int,
    bits: int,
    depth: NDArray[np.float64],
    triangle: NDArray[np.int32],
) -> None:
    """Draw triangles into ``depth`` (H, W), preset to inf, and ``triangle`` (H, W), preset to -1.

    Args:
        grid: vertices (V, 2) in units of 2^-bits pixels.
        inverse_depth: (V,) 1/m.
        usable: (V,), False for vertices whose triangles are dropped.
        faces: (T, 3).
        culled_sign: sign of the area, as seen in the image, of triangles to leave out; 0 for none.
        bits: fractional bits of the grid.
        depth: (H, W) metres, written; ties between triangles go to the lower index.
        triangle: (H, W), written.
    """
    height, width = depth.shape
    round_up = (1 << bits) - 1
    for index in range(len(faces)):
        a, b, c = faces[index, 0], faces[index, 1], faces[index, 2]
        if not (usable[a] and usable[b] and usable[c]):
            continue
        # scalars: views of single vertices would cost more than the triangle
        ax, bx, cx = grid[a, 0], grid[b, 0], grid[c, 0]
        ay, by, cy = grid[a, 1], grid[b, 1], grid[c, 1]
        left = max((min(ax, bx, cx) + round_up) >> bits, 0)
        right = min(max(ax, bx, cx) >> bits, width - 1)
        top = max((min(ay, by, cy) + round_up) >> bits, 0)
        bottom = min(max(ay, by, cy) >> bits, height - 1)
        if left > right or top > bottom:
            continue
        area = _cross(ax, ay, bx, by, cx, cy)
        if area == 0 or area * culled_sign > 0:
            continue
        if area < 0:
            b, c, bx, cx, by, cy, area = c, b, cx, bx, cy, by, -area
        inverse = (inverse_depth[a], inverse_depth[b], inverse_depth[c])
        box = (left, right, top, bottom)
        _fill_triangle((ax, ay, bx, by, cx, cy), inverse, area, box, bits, index, depth, triangle)


@numba.njit(nogil=True, cache=True)
def _cross(ax, ay, bx, by, x, y):  # type: ignore[no-untyped-def]
    """Twice the signed area of a, b, (x, y): positive on the inner side of the edge a, b."""
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@numba.njit(nogil=True, cache=True)
def _least(ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Smallest value of the edge a, b that counts as inside: 0 on top and left edges, else 1."""
    return 0 if by < ay or (by == ay and bx > ax) else 1


@numba.njit(nogil=True, cache=True)
def _fill_triangle(corners, inverse, area, box, bits, index, depth, triangle):  # type: ignore[no-untyped-def]
    """Draw one triangle of positive area; edge values grow by constant steps along a row."""
    ax, ay, bx, by, cx, cy = corners
    left, right, top, bottom = box
    least_a, least_b, least_c = (
        _least(bx, by, cx, cy),
        _least(cx, cy, ax, ay),
        _least(ax, ay, bx, by),
    )
    step_a, step_b, step_c = (by - cy) << bits, (cy - ay) << bits, (ay - by) << bits
    x = left << bits
    for row in range(top, bottom + 1):
        y = row << bits
        at_a = _cross(bx, by, cx, cy, x, y)
        at_b = _cross(cx, cy, ax, ay, x, y)
        at_c = _cross(ax, ay, bx, by, x, y)
        for column in range(left, right + 1):
            # the sign bit of the union says at once whether any edge has the pixel outside
            if ((at_a - least_a) | (at_b - least_b) | (at_c - least_c)) >= 0:
                blend = at_a * inverse[0] + at_b * inverse[1] + at_c * inverse[2]
                here = area / blend
                if here < depth[row, column]:
                    depth[row, column] = here
                    triangle[row, column] = index
            at_a += step_a
            at_b += step_b
            at_c += step_c
