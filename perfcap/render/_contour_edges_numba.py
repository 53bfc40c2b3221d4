"""Contour edges of one projected mesh on the CPU; ``_outline_reference.py`` has their twin.

Every triangle is a layer over the image, whichever way it faces. Where a surface goes on, the
borders of its layers cancel; what is left are the *contour edges*: folds between front- and
back-facing triangles, and rims of open meshes. No mesh is too broken for that: whatever the
triangles are, the sum of their borders is closed.

Coordinates are pixels, y down; a row is what lies between two integer ordinates.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class ContourEdges(NamedTuple):
    """Contour edges and the rows of a window they are in.

    Attributes:
        ends: vertices, (N, 2), such that layers grow towards the right-hand side.
        layers: how many are added from left to right, for horizontal edges downwards, (N,).
        lines: top and bottom y, x at the top, dx/dy, least and greatest x, (N, 6).
        start: first entry of each row, (R + 1,).
        order: edges of the rows by least x, ``order[start[r]:start[r + 1]]``.
    """

    ends: Integers
    layers: Integers
    lines: Floats
    start: Integers
    order: Integers


def contour_edges(
    points: Floats, faces: Integers, face_edges: Integers, edge_ends: Integers, window: Floats
) -> ContourEdges:
    """Contour edges that can matter inside a window: none above, below or right of it.

    Args:
        points: (U, 2) px, NaN for those whose triangles are left out.
        faces: (T, 3).
        face_edges: edge from each corner to the next, (T, 3).
        edge_ends: vertices of each edge, the lower first, (E, 2).
        window: left, top, right, bottom.
    """
    ends, layers, lines = _find(points, faces, face_edges, edge_ends, window)
    return ContourEdges(ends, layers, lines, *_bucket_rows(lines, lines[:, 4].argsort(), window))


@kernel()
def _find(points, faces, face_edges, edge_ends, window):  # type: ignore[no-untyped-def]
    """Ends, layers and lines of contour edges."""
    surplus = _add_borders(points, faces, face_edges, len(edge_ends))
    most = 0
    for edge in range(len(edge_ends)):
        most += surplus[edge] != 0
    ends, layers = np.empty((most, 2), dtype=np.int64), np.empty(most, dtype=np.int64)
    lines = np.empty((most, 6))
    count = 0
    for edge in range(len(edge_ends)):
        if surplus[edge] == 0:
            continue
        a, b = edge_ends[edge, 0], edge_ends[edge, 1]
        if surplus[edge] < 0:
            a, b = b, a
        ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
        if max(ay, by) < window[1] or min(ay, by) > window[3] or min(ax, bx) > window[2]:
            continue
        ends[count, 0], ends[count, 1] = a, b
        adds = ay > by if ay != by else bx > ax
        layers[count] = abs(surplus[edge]) if adds else -abs(surplus[edge])
        _set_line(ax, ay, bx, by, lines[count])
        count += 1
    return ends[:count], layers[:count], lines[:count]


@inner()
def _add_borders(points, faces, face_edges, edges):  # type: ignore[no-untyped-def]
    """Layers on the right-hand side of each edge, from its lower to its higher vertex."""
    surplus = np.zeros(edges, dtype=np.int32)
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay = points[a, 0], points[a, 1]
        area = (points[b, 0] - ax) * (points[c, 1] - ay) - (points[b, 1] - ay) * (points[c, 0] - ax)
        if area > 0:
            side = 1
        elif area < 0:
            side = -1
        else:  # no area, or not a number
            continue
        surplus[face_edges[face, 0]] += side if a < b else -side
        surplus[face_edges[face, 1]] += side if b < c else -side
        surplus[face_edges[face, 2]] += side if c < a else -side
    return surplus


@inner()
def _set_line(ax, ay, bx, by, line):  # type: ignore[no-untyped-def]
    # from the top, so that edges that lie on one another agree to the last bit
    if ay > by:
        ax, ay, bx, by = bx, by, ax, ay
    line[0], line[1], line[2] = ay, by, ax
    line[3] = (bx - ax) / (by - ay) if by > ay else 0.0
    line[4], line[5] = min(ax, bx), max(ax, bx)


@kernel()
def _bucket_rows(lines, by_left, window):  # type: ignore[no-untyped-def]
    first = math.floor(window[1])
    rows = math.floor(window[3]) - first + 1
    start = np.zeros(rows + 1, dtype=np.int64)
    for edge in range(len(lines)):
        for row in range(first_row(lines, edge, first), _last_row(lines, edge, first, rows) + 1):
            start[row + 1] += 1
    place = accumulate(start)
    order = np.empty(start[rows], dtype=np.int64)
    for edge in by_left:
        for row in range(first_row(lines, edge, first), _last_row(lines, edge, first, rows) + 1):
            order[place[row]] = edge
            place[row] += 1
    return start, order


@kernel()
def accumulate(start):  # type: ignore[no-untyped-def]
    """Sum up counts in place; returns a copy, to be moved on as entries are placed."""
    place = np.zeros(len(start), dtype=np.int64)
    for group in range(1, len(start)):
        start[group] += start[group - 1]
        place[group] = start[group]
    return place


@inner()
def first_row(lines, edge, first):  # type: ignore[no-untyped-def]
    """First row of the window that an edge is in, where ``first`` is the window's own."""
    return max(math.floor(lines[edge, 0]) - first, 0)


@inner()
def _last_row(lines, edge, first, rows):  # type: ignore[no-untyped-def]
    return min(math.floor(lines[edge, 1]) - first, rows - 1)
