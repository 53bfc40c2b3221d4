"""Hard z-buffer on the CPU: one pass over triangles, one pass over the pixels of each.

The plain-torch twin in ``_zbuffer_reference.py`` states the same thing without loops; tests hold
the two equal. Arithmetic on the pixel grid is in integers, so coverage is exact.
"""

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel


# NumPy's division: asking whether a divisor is zero takes time, and areas never are
@kernel(error_model="numpy")
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
    for index in range(len(faces)):
        # numbers without a sign: others may count from the end, and asking takes time
        a, b, c = np.uint64(faces[index, 0]), np.uint64(faces[index, 1]), np.uint64(faces[index, 2])
        if not (usable[a] and usable[b] and usable[c]):
            continue
        # scalars: views of single vertices would cost more than the triangle
        corners = (grid[a, 0], grid[a, 1], grid[b, 0], grid[b, 1], grid[c, 0], grid[c, 1])
        left, right, top, bottom = _box(corners, bits, depth.shape)
        if left > right or top > bottom:
            continue
        area = _cross(*corners)
        if area == 0 or area * culled_sign > 0:
            continue
        if area < 0:
            corners = corners[:2] + corners[4:] + corners[2:4]
            b, c, area = c, b, -area
        one, two, three = inverse_depth[a], inverse_depth[b], inverse_depth[c]
        least, start, across, down = _edges(corners, left << bits, top << bits, bits)
        for row in range(np.uint64(top), np.uint64(bottom + 1)):
            at_a, at_b, at_c = start
            for column in range(np.uint64(left), np.uint64(right + 1)):
                # the sign bit of the union says at once whether any edge has the pixel outside
                if ((at_a - least[0]) | (at_b - least[1]) | (at_c - least[2])) >= 0:
                    here = area / (at_a * one + at_b * two + at_c * three)
                    if here < depth[row, column]:
                        depth[row, column] = here
                        triangle[row, column] = index
                at_a += across[0]
                at_b += across[1]
                at_c += across[2]
            start = (start[0] + down[0], start[1] + down[1], start[2] + down[2])


@kernel()
def cover(
    grid: NDArray[np.int64],
    usable: NDArray[np.bool_],
    faces: NDArray[np.int64],
    bits: int,
    covered: NDArray[np.uint8],
) -> None:
    """Set pixels (H, W) to 1 where ``fill`` draws any triangle; arguments as there.

    Without depths there is nothing to decide: a pixel is never asked for, and in a row of them no
    jump can be guessed wrong.
    """
    for index in range(len(faces)):
        a, b, c = np.uint64(faces[index, 0]), np.uint64(faces[index, 1]), np.uint64(faces[index, 2])
        if not (usable[a] and usable[b] and usable[c]):
            continue
        corners = (grid[a, 0], grid[a, 1], grid[b, 0], grid[b, 1], grid[c, 0], grid[c, 1])
        left, right, top, bottom = _box(corners, bits, covered.shape)
        if left > right or top > bottom:
            continue
        area = _cross(*corners)
        if area == 0:
            continue
        if area < 0:
            corners = corners[:2] + corners[4:] + corners[2:4]
        least, start, across, down = _edges(corners, left << bits, top << bits, bits)
        for row in range(np.uint64(top), np.uint64(bottom + 1)):
            at_a, at_b, at_c = start[0] - least[0], start[1] - least[1], start[2] - least[2]
            for column in range(np.uint64(left), np.uint64(right + 1)):
                covered[row, column] |= np.uint8(((at_a | at_b | at_c) >> 63) + 1)
                at_a += across[0]
                at_b += across[1]
                at_c += across[2]
            start = (start[0] + down[0], start[1] + down[1], start[2] + down[2])


@inner()
def _box(corners, bits, shape):  # type: ignore[no-untyped-def]
    """First and last column, first and last row of an image that a triangle may cover."""
    ax, ay, bx, by, cx, cy = corners
    round_up = (1 << bits) - 1
    left = max((min(ax, bx, cx) + round_up) >> bits, 0)
    right = min(max(ax, bx, cx) >> bits, shape[1] - 1)
    top = max((min(ay, by, cy) + round_up) >> bits, 0)
    bottom = min(max(ay, by, cy) >> bits, shape[0] - 1)
    return left, right, top, bottom


@inner()
def _cross(ax, ay, bx, by, x, y):  # type: ignore[no-untyped-def]
    """Twice the signed area of a, b, (x, y): positive on the inner side of the edge a, b."""
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@inner()
def _least(ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Smallest value of the edge a, b that counts as inside: 0 on top and left edges, else 1."""
    return 0 if by < ay or (by == ay and bx > ax) else 1


@inner()
def _edges(corners, x, y, bits):  # type: ignore[no-untyped-def]
    """The edges opposite to each corner of a triangle of positive area.

    Their least values inside, values at a pixel, and constant steps of these to the next column
    and to the next row.
    """
    ax, ay, bx, by, cx, cy = corners
    least = (_least(bx, by, cx, cy), _least(cx, cy, ax, ay), _least(ax, ay, bx, by))
    at = (_cross(bx, by, cx, cy, x, y), _cross(cx, cy, ax, ay, x, y), _cross(ax, ay, bx, by, x, y))
    across = ((by - cy) << bits, (cy - ay) << bits, (ay - by) << bits)
    down = ((cx - bx) << bits, (ax - cx) << bits, (bx - ax) << bits)
    return least, at, across, down


@kernel(error_model="numpy")
def snap(
    pixels: NDArray[np.float64],
    depth: NDArray[np.float64],
    limits: tuple[float, float],
    unit: float,
    grid: NDArray[np.int64],
    inverse_depth: NDArray[np.float64],
    usable: NDArray[np.bool_],
) -> None:
    """Put vertices onto the grid, as ``fill`` takes them; those that are not usable lie at zero.

    Args:
        pixels: (V, 2).
        depth: (V,) m.
        limits: px from the origin up to which, and depth from which on, a vertex is usable.
        unit: of the grid, in a pixel.
        grid: (V, 2), written.
        inverse_depth: (V,), written.
        usable: (V,), written.
    """
    for i in range(len(depth)):
        x, y, z = pixels[i, 0], pixels[i, 1], depth[i]
        # comparisons with what is no number are false
        known = abs(x) <= limits[0] and abs(y) <= limits[0] and limits[1] <= z < np.inf
        usable[i] = known
        grid[i, 0] = np.int64(np.rint(x * unit)) if known else 0
        grid[i, 1] = np.int64(np.rint(y * unit)) if known else 0
        inverse_depth[i] = 1.0 / z if known else 1.0


@kernel()
def extent(
    pixels: NDArray[np.float64], depth: NDArray[np.float64], limits: tuple[float, float]
) -> tuple[float, float, float, float]:
    """Least and greatest x, least and greatest y of usable vertices; infinite without any.

    Arguments are those of ``snap``.
    """
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(depth)):
        x, y, z = pixels[i, 0], pixels[i, 1], depth[i]
        if abs(x) <= limits[0] and abs(y) <= limits[0] and limits[1] <= z < np.inf:
            left, right = min(left, x), max(right, x)
            top, bottom = min(top, y), max(bottom, y)
    return left, right, top, bottom
