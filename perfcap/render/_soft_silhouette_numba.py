"""Soft silhouette on the CPU: one pass along the outline, one pass over the covered rows.

The plain-torch twin in ``_soft_silhouette_reference.py`` states the same thing without loops;
tests hold the two equal.

The derivative of coverage is sparse, and comes as *records*: where pixel p sees the point that is
the share t of the way from vertex a to vertex b, and that point moves by (vx, vy) pixels, coverage
of p changes by gx * vx + gy * vy.
"""

import math

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel
from perfcap.render._contour_edges_numba import contour_edges
from perfcap.render._outline_numba import outline
from perfcap.render._soft_silhouette_reference import NEAREST, PARALLEL

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Real = NDArray[np.floating]


def draw(
    points: Floats,
    faces: Integers,
    face_edges: Integers,
    edge_ends: Integers,
    band: float,
    coverage: Real,
) -> tuple[Integers, Floats]:
    """Draw one frame into ``coverage`` (H, W), preset to zero.

    Args:
        points: (U, 2) px, NaN for vertices whose triangles are left out.
        faces: (T, 3).
        face_edges: edge from each corner to the next, (T, 3).
        edge_ends: vertices of each edge, the lower first, (E, 2).
        band: half its width, px.
        coverage: written.

    Returns:
        Records: pixel, a, b (N, 3), and t, gx, gy (N, 3); pixels row by row.
    """
    height, width = coverage.shape
    window = np.array([-band, -band, width - 1 + band, height - 1 + band])
    edges = contour_edges(points, faces, face_edges, edge_ends, window)
    border = outline(points, edges, window)
    # not one kernel that calls all others, which would compile everything once more
    names, values = _shade(points, edges, border, window, coverage)
    return names, values


@kernel()
def _shade(points, edges, border, window, coverage):  # type: ignore[no-untyped-def]
    """Write coverage, and return the records."""
    height, width = coverage.shape
    band = -window[0]
    box = _box(points, band, height, width)
    nearest = np.empty((height, width), dtype=np.int32)
    distance = np.empty((height, width), dtype=np.float32)
    for row in range(box[2], box[3]):
        for column in range(box[0], box[1]):
            nearest[row, column], distance[row, column] = -1, np.inf
    touched = 0
    for piece in range(len(border.lines)):
        touched += _draw_band(border.lines[piece], piece, band, nearest, distance)
    first = math.floor(window[1])
    return _fill(points, border, edges, band, first, box, nearest, touched, coverage)


@inner()
def _box(points, band, height, width):  # type: ignore[no-untyped-def]
    """Pixels that the silhouette and its band can reach: columns and rows, from and to."""
    left, right, top, bottom = width * 1.0, -1.0, height * 1.0, -1.0
    for point in range(len(points)):
        x, y = points[point, 0], points[point, 1]
        if x == x:  # a number
            left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
    columns = max(math.ceil(left - band), 0), min(math.floor(right + band) + 1, width)
    rows = max(math.ceil(top - band), 0), min(math.floor(bottom + band) + 1, height)
    return columns[0], max(columns), rows[0], max(rows)


@inner()
def _draw_band(line, piece, band, nearest, distance):  # type: ignore[no-untyped-def]
    """Enter a piece where it is nearer than those before; returns how many pixels were empty."""
    x0, y0, dx, dy, squared = line
    height, width = nearest.shape
    touched = 0
    first = max(math.ceil(min(y0, y0 + dy) - band), 0)
    last = min(math.floor(max(y0, y0 + dy) + band), height - 1)
    for row in range(first, last + 1):
        left, right = _reach(line, row, band)
        off_y = row - y0
        for column in range(max(math.ceil(left), 0), min(math.floor(right), width - 1) + 1):
            off_x = column - x0
            along = min(max((off_x * dx + off_y * dy) / squared, 0.0), 1.0)
            gap_x, gap_y = off_x - along * dx, off_y - along * dy
            gap = gap_x * gap_x + gap_y * gap_y
            if gap >= band * band:
                continue
            # single precision breaks ties towards the lower index, in both implementations
            rounded = np.float32(gap)
            if rounded < distance[row, column]:
                touched += nearest[row, column] < 0
                nearest[row, column], distance[row, column] = piece, rounded
    return touched


@inner()
def _reach(line, row, band):  # type: ignore[no-untyped-def]
    """Abscissae between which a row can be nearer than ``band`` to a piece."""
    x0, y0, dx, dy, _ = line
    begin, finish = 0.0, 1.0
    if dy != 0.0:
        one, two = (row - band - y0) / dy, (row + band - y0) / dy
        begin, finish = max(begin, min(one, two)), min(finish, max(one, two))
    one, two = x0 + begin * dx, x0 + finish * dx
    return min(one, two) - band, max(one, two) + band


@inner()
def _fill(points, border, edges, band, first, box, nearest, touched, coverage):  # type: ignore[no-untyped-def]
    """Write coverage within the box, and the records of the band."""
    names = np.empty((2 * touched, 3), dtype=np.int64)
    values = np.empty((2 * touched, 3))
    added = np.zeros(box[1] - box[0] + 1, dtype=np.int64)
    found = 0
    for row in range(box[2], box[3]):
        _add_layers(edges, row, row - first, box[0], added)
        layers = 0
        for column in range(box[0], box[1]):
            layers += added[column - box[0]]
            piece = nearest[row, column]
            if piece < 0:
                coverage[row, column] = 1.0 if layers > 0 else 0.0
                continue
            side = 1.0 if layers > 0 else -1.0
            seen = _look(border.lines[piece], column, row, side, band)
            coverage[row, column] = seen[0]
            pixel = row * coverage.shape[1] + column
            found = _record(points, border, piece, seen, pixel, found, names, values)
    return names[:found], values[:found]


@inner()
def _add_layers(edges, row, bucket, left, added):  # type: ignore[no-untyped-def]
    """Layers added at each pixel of a row, from ``left`` on; the last entry is beyond."""
    added[:] = 0
    for k in range(edges.start[bucket], edges.start[bucket + 1]):
        edge = edges.order[k]
        top, bottom = edges.lines[edge, 0], edges.lines[edge, 1]
        if top <= row < bottom:
            x = edges.lines[edge, 2] + (row - top) * edges.lines[edge, 3]
            added[min(max(math.ceil(x) - left, 0), len(added) - 1)] += edges.layers[edge]


@inner()
def _look(line, column, row, side, band):  # type: ignore[no-untyped-def]
    """Coverage of a pixel, share of the piece it sees, and derivative in the point seen."""
    x0, y0, dx, dy, squared = line
    off_x, off_y = column - x0, row - y0
    along = min(max((off_x * dx + off_y * dy) / squared, 0.0), 1.0)
    gap_x, gap_y = off_x - along * dx, off_y - along * dy
    gap = math.sqrt(gap_x * gap_x + gap_y * gap_y)
    level = min(max(0.5 + 0.5 * side * gap / band, 0.0), 1.0)
    slope = 3.0 * level * (1.0 - level) / band
    if gap > NEAREST:
        scale = -side * slope / gap
        return level * level * (3.0 - 2.0 * level), along, scale * gap_x, scale * gap_y
    scale = slope / math.sqrt(squared)  # inward is the right-hand side
    return level * level * (3.0 - 2.0 * level), along, scale * dy, -scale * dx


@inner()
def _record(points, border, piece, seen, pixel, found, names, values):  # type: ignore[no-untyped-def]
    """Write the record of a pixel, or two where it sees a crossing; returns how many there are."""
    vertices, shares = border.vertices[piece], border.shares[piece]
    _, along, gx, gy = seen
    end = 0 if along == 0.0 else (1 if along == 1.0 else -1)
    share = shares[0] + along * (shares[1] - shares[0]) if end < 0 else shares[end]
    _write(names[found], values[found], pixel, vertices[0], vertices[1], share, gx, gy)
    if end < 0 or vertices[2 + 2 * end] < 0:
        return found + 1
    # a crossing moves such that it stays on both lines: split along their normals
    c, d = vertices[2 + 2 * end], vertices[3 + 2 * end]
    mx, my = _normal(points, vertices[0], vertices[1])
    nx, ny = _normal(points, c, d)
    sine = mx * ny - my * nx
    if abs(sine) < PARALLEL:
        return found + 1
    own, other = (gx * ny - gy * nx) / sine, (mx * gy - my * gx) / sine
    values[found, 1], values[found, 2] = own * mx, own * my
    name, value = names[found + 1], values[found + 1]
    _write(name, value, pixel, c, d, shares[2 + end], other * nx, other * ny)
    return found + 2


@inner()
def _write(name, value, pixel, a, b, share, gx, gy):  # type: ignore[no-untyped-def]
    name[0], name[1], name[2] = pixel, a, b
    value[0], value[1], value[2] = share, gx, gy


@inner()
def _normal(points, a, b):  # type: ignore[no-untyped-def]
    dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    length = math.hypot(dx, dy)
    return -dy / length, dx / length


@kernel()
def pull_back(names: Integers, values: Floats, gradient: Real, points: Floats) -> None:
    """Add the gradient of pixels (H * W,) to that of points (U, 2), in place."""
    for record in range(len(names)):
        a, b = names[record, 1], names[record, 2]
        here = np.float64(gradient[names[record, 0]])
        gx, gy, share = here * values[record, 1], here * values[record, 2], values[record, 0]
        points[a, 0] += (1.0 - share) * gx
        points[a, 1] += (1.0 - share) * gy
        points[b, 0] += share * gx
        points[b, 1] += share * gy
