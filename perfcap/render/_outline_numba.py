"""Silhouette outline of one projected mesh on the CPU; ``_outline_reference.py`` is its twin.

Contour edges are cut where they cross each other. The pieces that have no layer of surface on one
side and some on the other are the outline of the silhouette; the others lie inside it. Layers are
counted from far left along a horizontal line through the middle of a piece, for each piece afresh,
so that no error is carried along.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel
from perfcap.render._contour_edges_numba import ContourEdges, accumulate, first_row
from perfcap.render._outline_reference import SHORT, TOUCH

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Outline(NamedTuple):
    """Pieces of contour edges between covered and empty image.

    Attributes:
        vertices: ends of the edge, then those of the edge that cuts the piece off at its
            beginning and of the one at its end, -1 for none, (P, 6).
        shares: of the edge where the piece begins and ends, of the cutting edges there, (P, 4).
        lines: x and y of the beginning, the vector to the end, its squared length, (P, 5).
    """

    vertices: Integers
    shares: Floats
    lines: Floats


@kernel()
def outline(points: Floats, edges: ContourEdges, window: Floats) -> Outline:
    """Outline of the silhouette inside a window.

    Args:
        points: (U, 2) px.
        edges: of these points and this window.
        window: left, top, right, bottom.
    """
    pairs, shares = _crossings(points, edges, window)
    start, order = _cuts_of_edges(pairs, shares, len(edges.ends))
    most = len(edges.ends) + 2 * len(pairs)
    vertices, kept = np.empty((most, 6), dtype=np.int64), np.empty((most, 4))
    found = 0
    for edge in range(len(edges.ends)):
        a, b = edges.ends[edge, 0], edges.ends[edge, 1]
        line = (
            points[a, 0],
            points[a, 1],
            points[b, 0] - points[a, 0],
            points[b, 1] - points[a, 1],
        )
        length = math.hypot(line[2], line[3])
        here, finish = _clip(line, window)
        here_cut = -1
        for k in range(start[edge], start[edge + 1] + 1):
            cut = order[k] if k < start[edge + 1] else -1
            share = shares[cut >> 1, cut & 1] if cut >= 0 else finish
            if not (here < share <= finish):
                continue
            long = (share - here) * length > SHORT
            if long and _is_border(edge, line, 0.5 * (here + share), edges, window):
                vertices[found, 0], vertices[found, 1] = a, b
                kept[found, 0], kept[found, 1] = here, share
                _set_cut(0, here_cut, edges, pairs, shares, vertices[found], kept[found])
                _set_cut(1, cut, edges, pairs, shares, vertices[found], kept[found])
                found += 1
            here, here_cut = share, cut
    return Outline(vertices[:found], kept[:found], _lines(points, vertices[:found], kept))


@inner()
def _lines(points, vertices, shares):  # type: ignore[no-untyped-def]
    lines = np.empty((len(vertices), 5))
    for piece in range(len(vertices)):
        a, b = vertices[piece, 0], vertices[piece, 1]
        dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        part = shares[piece, 1] - shares[piece, 0]
        lines[piece, 0] = points[a, 0] + shares[piece, 0] * dx
        lines[piece, 1] = points[a, 1] + shares[piece, 0] * dy
        dx, dy = part * dx, part * dy
        lines[piece, 2], lines[piece, 3], lines[piece, 4] = dx, dy, dx * dx + dy * dy
    return lines


@inner()
def _set_cut(side, cut, edges, pairs, shares, vertices, kept):  # type: ignore[no-untyped-def]
    """Note which edge cuts a piece off at its beginning (0) or end (1)."""
    vertices[2 + 2 * side], vertices[3 + 2 * side], kept[2 + side] = -1, -1, 0.0
    if cut >= 0:
        other = 1 - (cut & 1)
        vertices[2 + 2 * side] = edges.ends[pairs[cut >> 1, other], 0]
        vertices[3 + 2 * side] = edges.ends[pairs[cut >> 1, other], 1]
        kept[2 + side] = shares[cut >> 1, other]


@inner()
def _crossings(points, edges, window):  # type: ignore[no-untyped-def]
    """Pairs of contour edges that cross (K, 2), and the share of each edge there (K, 2)."""
    first = math.floor(window[1])
    found = 0
    pairs = np.empty((64, 2), dtype=np.int64)
    shares = np.empty((64, 2))
    for row in range(len(edges.start) - 1):
        for i in range(edges.start[row], edges.start[row + 1]):
            one = edges.order[i]
            right = edges.lines[one, 5]
            if right < window[0]:
                continue
            begins = first_row(edges.lines, one, first) == row
            for j in range(i + 1, edges.start[row + 1]):
                two = edges.order[j]
                if edges.lines[two, 4] > right:
                    break
                # each pair once: in the first row that both are in
                if not begins and first_row(edges.lines, two, first) != row:
                    continue
                at_one, at_two = _crossing(points, edges.ends[one], edges.ends[two])
                if at_one < 0:
                    continue
                if found == len(pairs):
                    pairs, shares = _enlarged(pairs, shares)
                pairs[found, 0], pairs[found, 1] = one, two
                shares[found, 0], shares[found, 1] = at_one, at_two
                found += 1
    return pairs[:found], shares[:found]


@inner()
def _enlarged(pairs, shares):  # type: ignore[no-untyped-def]
    more_pairs = np.empty((2 * len(pairs), 2), dtype=np.int64)
    more_shares = np.empty((2 * len(pairs), 2))
    for row in range(len(pairs)):
        for side in range(2):
            more_pairs[row, side], more_shares[row, side] = pairs[row, side], shares[row, side]
    return more_pairs, more_shares


@inner()
def _crossing(points, one, two):  # type: ignore[no-untyped-def]
    """Shares of two edges where they cross, -1 where they do not.

    A vertex on another edge counts as on its right-hand side, so that a chain through there
    crosses once. Edges that share a vertex do not cross.
    """
    a, b, c, d = one[0], one[1], two[0], two[1]
    if a in (c, d) or b in (c, d):
        return -1.0, -1.0
    ax, ay, cx, cy = points[a, 0], points[a, 1], points[c, 0], points[c, 1]
    ux, uy = points[b, 0] - ax, points[b, 1] - ay
    at_c = ux * (cy - ay) - uy * (cx - ax)
    at_d = ux * (points[d, 1] - ay) - uy * (points[d, 0] - ax)
    if (at_c >= 0) == (at_d >= 0):
        return -1.0, -1.0
    vx, vy = points[d, 0] - cx, points[d, 1] - cy
    at_a = vx * (ay - cy) - vy * (ax - cx)
    at_b = vx * (points[b, 1] - cy) - vy * (points[b, 0] - cx)
    if (at_a >= 0) == (at_b >= 0):
        return -1.0, -1.0
    return at_a / (at_a - at_b), at_c / (at_c - at_d)


@inner()
def _cuts_of_edges(pairs, shares, edges):  # type: ignore[no-untyped-def]
    """Cuts of each edge by ascending share, ``order[start[e]:start[e + 1]]``.

    A cut is twice its crossing, plus one for the second edge of the pair.
    """
    start = np.zeros(edges + 1, dtype=np.int64)
    for crossing in range(len(pairs)):
        start[pairs[crossing, 0] + 1] += 1
        start[pairs[crossing, 1] + 1] += 1
    end = accumulate(start)
    order = np.empty(2 * len(pairs), dtype=np.int64)
    for cut in range(2 * len(pairs)):
        edge, share = pairs[cut >> 1, cut & 1], shares[cut >> 1, cut & 1]
        at = end[edge]
        while at > start[edge] and shares[order[at - 1] >> 1, order[at - 1] & 1] > share:
            order[at] = order[at - 1]
            at -= 1
        order[at] = cut
        end[edge] += 1
    return start, order


@inner()
def _clip(line, window):  # type: ignore[no-untyped-def]
    """Shares between which a segment is in the window; the first is larger where it is not."""
    begin, finish = 0.0, 1.0
    for axis in range(2):
        origin, step = line[axis], line[2 + axis]
        low, high = window[axis], window[2 + axis]
        if step == 0.0:
            if origin < low or origin > high:
                finish = -1.0
            continue
        one, two = (low - origin) / step, (high - origin) / step
        begin, finish = max(begin, min(one, two)), min(finish, max(one, two))
    return begin, finish


@inner()
def _is_border(edge, line, share, edges, window):  # type: ignore[no-untyped-def]
    """Whether an edge has layers on one side only at a share of its length, 0 to 1."""
    top, bottom, top_x, slope = edges.lines[edge, :4]
    flat = top == bottom
    y = line[1] + share * line[3]
    x = line[0] + share * line[2] if flat else top_x + (y - top) * slope
    before = 0
    near = edges.layers[edge]  # of this edge and of those that lie on it
    row = min(max(math.floor(y) - math.floor(window[1]), 0), len(edges.start) - 2)
    for k in range(edges.start[row], edges.start[row + 1]):
        other = edges.order[k]
        begins, ends = edges.lines[other, 0], edges.lines[other, 1]
        if edges.lines[other, 4] > x + TOUCH:
            break
        if other == edge:
            continue
        if begins <= y < ends:
            apart = edges.lines[other, 2] + (y - begins) * edges.lines[other, 3] - x
            if apart < -TOUCH:
                before += edges.layers[other]
            elif apart <= TOUCH and not flat:
                near += edges.layers[other]
        elif flat and begins == y == ends and edges.lines[other, 4] <= x < edges.lines[other, 5]:
            near += edges.layers[other]
    if flat:  # the horizontal line through such an edge runs just below it
        near = -near
    return (before > 0) != (before + near > 0)
