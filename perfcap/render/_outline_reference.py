"""Silhouette outlines in plain torch: the statement that the numba kernels are held to.

All frames at once; an edge or piece carries the number of its frame, and vertices of frame f are
counted on from f * U. See ``_contour_edges_numba.py`` and ``_outline_numba.py`` for the method.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

TOUCH = 1e-7  # px, edges nearer than this lie on one another
SHORT = 1e-9  # px, shorter pieces are dropped
CANDIDATES = 1 << 22  # pairs tested at once: about 0.5 GB of intermediates


@dataclass(frozen=True)
class ContourEdges:
    """Contour edges of all frames, and those of each row of each frame.

    Attributes:
        frame: (N,).
        ends: vertices, (N, 2), layers grow towards the right-hand side.
        corners: where they are, (N, 2, 2) px.
        layers: added from left to right, for horizontal edges downwards, (N,).
        lines: top and bottom y, x at the top, dx/dy, least and greatest x, (N, 6).
        first_bucket: of each edge, (N,); R buckets a frame, one a row.
        start: first entry of each bucket, (F * R + 1,).
        order: edges of the buckets, ``order[start[r]:start[r + 1]]``, ascending.
    """

    frame: Tensor
    ends: Tensor
    corners: Tensor
    layers: Tensor
    lines: Tensor
    first_bucket: Tensor
    start: Tensor
    order: Tensor


@dataclass(frozen=True)
class Outline:
    """Pieces of contour edges between covered and empty image; see the numba twin."""

    frame: Tensor
    vertices: Tensor
    shares: Tensor
    lines: Tensor


@dataclass(frozen=True)
class _Cuts:
    """Crossings, listed for both edges: the edge, its share, the other edge and its share."""

    edge: Tensor
    share: Tensor
    other: Tensor
    other_share: Tensor


def contour_edges(
    points: Tensor, faces: Tensor, face_edges: Tensor, edge_ends: Tensor, window: Tensor
) -> ContourEdges:
    """Contour edges (of all frames) that can matter inside a window.

    Args:
        points: (F, U, 2) px float64, NaN for those whose triangles are left out.
        faces: (T, 3).
        face_edges: edge from each corner to the next, (T, 3).
        edge_ends: vertices of each edge, the lower first, (E, 2).
        window: left, top, right, bottom, (4,).
    """
    surplus = _add_borders(points, faces, face_edges, len(edge_ends))
    frame, edge = torch.nonzero(surplus, as_tuple=True)
    surplus = surplus[frame, edge]
    ends = torch.where(surplus[:, None] < 0, edge_ends[edge].flip(-1), edge_ends[edge])
    corners = points[frame[:, None], ends]  # N 2 2
    low, high = corners.amin(1), corners.amax(1)
    kept = (high[:, 1] >= window[1]) & (low[:, 1] <= window[3]) & (low[:, 0] <= window[2])
    frame, ends, corners = (
        frame[kept],
        ends[kept] + frame[kept, None] * points.shape[1],
        corners[kept],
    )
    dx, dy = (corners[:, 1] - corners[:, 0]).unbind(-1)
    adds = torch.where(dy != 0, dy < 0, dx > 0)
    layers = torch.where(adds, surplus[kept].abs(), -surplus[kept].abs())
    lines = _lines(corners)
    return ContourEdges(
        frame, ends, corners, layers, lines, *_bucket_rows(frame, lines, window, len(points))
    )


def _add_borders(points: Tensor, faces: Tensor, face_edges: Tensor, edges: int) -> Tensor:
    """Layers on the right-hand side of each edge, from its lower to its higher vertex, (F, E)."""
    a, b, c = points[:, faces].unbind(2)  # F T 2
    area = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
        c[..., 0] - a[..., 0]
    )
    side = (area > 0).long() - (area < 0).long()  # zero where it is not a number
    along = torch.where(faces < faces.roll(-1, 1), 1, -1)  # T 3
    amount = (side[..., None] * along).flatten(1)  # F 3T
    surplus = torch.zeros(len(points), edges, dtype=torch.int64, device=points.device)
    return surplus.scatter_add_(1, face_edges.flatten().expand_as(amount), amount)


def _lines(corners: Tensor) -> Tensor:
    turned = (corners[:, 0, 1] > corners[:, 1, 1])[:, None, None]
    top, bottom = torch.where(turned, corners.flip(1), corners).unbind(1)
    rise = bottom - top
    slope = torch.where(rise[:, 1] > 0, rise[:, 0] / rise[:, 1], 0.0)
    low, high = corners[..., 0].amin(1), corners[..., 0].amax(1)
    return torch.stack([top[:, 1], bottom[:, 1], top[:, 0], slope, low, high], -1)


def _bucket_rows(
    frame: Tensor, lines: Tensor, window: Tensor, frames: int
) -> tuple[Tensor, Tensor, Tensor]:
    """First bucket of each edge, first entry of each bucket, and the entries."""
    first, last = window[[1, 3]].floor().long().tolist()
    rows = last - first + 1
    top = (lines[:, 0].floor().long() - first).clamp_min(0)
    bottom = (lines[:, 1].floor().long() - first).clamp_max(rows - 1)
    owner, offset = expand(bottom - top + 1)
    first_bucket = frame * rows + top
    bucket = first_bucket[owner] + offset
    counts = torch.bincount(bucket, minlength=frames * rows)
    start = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
    return first_bucket, start, owner[bucket.argsort(stable=True)]


def outlines(edges: ContourEdges, window: Tensor) -> Outline:
    """Outlines of the silhouettes inside a window."""
    cuts = _crossings(edges, window)
    begin, finish = _clip(edges, window)
    inside = (begin[cuts.edge] < cuts.share) & (cuts.share <= finish[cuts.edge])
    count = len(edges.frame)
    every = torch.arange(count, device=begin.device)
    # breaks: all beginnings, all cuts, all ends; a piece lies between two consecutive of an edge
    edge = torch.cat([every, cuts.edge[inside], every])
    share = torch.cat([begin, cuts.share[inside], finish])
    none = torch.full_like(every, -1)
    other = torch.cat([none, cuts.other[inside], none])
    other_share = torch.cat([begin * 0, cuts.other_share[inside], begin * 0])
    order = share.argsort(stable=True)
    order = order[edge[order].argsort(stable=True)]
    edge, share, other, other_share = edge[order], share[order], other[order], other_share[order]
    length = edges.corners.diff(dim=1).squeeze(1).norm(dim=-1)
    long = (edge[1:] == edge[:-1]) & ((share[1:] - share[:-1]) * length[edge[1:]] > SHORT)
    (piece,) = torch.nonzero(long, as_tuple=True)
    piece = piece[_is_border(edges, edge[piece], 0.5 * (share[piece] + share[piece + 1]), window)]
    cut = torch.stack([other[piece], other[piece + 1]], -1)  # P 2
    cut_ends = torch.where(cut[..., None] >= 0, edges.ends[cut.clamp_min(0)], -1)
    names = torch.cat([edges.ends[edge[piece]], cut_ends.flatten(1)], -1)
    ends = torch.stack([share[piece], share[piece + 1]], -1)
    others = torch.stack([other_share[piece], other_share[piece + 1]], -1)
    shares = torch.cat([ends, others], -1)
    return Outline(
        edges.frame[edge[piece]], names, shares, _piece_lines(edges.corners[edge[piece]], ends)
    )


def _piece_lines(corners: Tensor, shares: Tensor) -> Tensor:
    """Beginning, vector and squared length of pieces, (P, 5)."""
    whole = corners[:, 1] - corners[:, 0]
    vector = (shares[:, 1:] - shares[:, :1]) * whole
    squared = vector[:, :1] * vector[:, :1] + vector[:, 1:] * vector[:, 1:]
    return torch.cat([corners[:, 0] + shares[:, :1] * whole, vector, squared], -1)


def _crossings(edges: ContourEdges, window: Tensor) -> _Cuts:
    """Where contour edges of a frame cross."""
    found = [_cross(edges, *pair) for pair in _pairs(edges, window)]
    one, two, at_one, at_two = (torch.cat(column) for column in zip(*found, strict=True))
    return _Cuts(
        edge=torch.cat([one, two]),
        share=torch.cat([at_one, at_two]),
        other=torch.cat([two, one]),
        other_share=torch.cat([at_two, at_one]),
    )


def _pairs(edges: ContourEdges, window: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
    """Pairs of edges that share a row, some at a time; each pair once."""
    entries = len(edges.order)
    position = torch.arange(entries, device=edges.order.device)
    bucket = torch.searchsorted(edges.start, position, right=True) - 1
    later = edges.start[bucket + 1] - position - 1
    for chunk in chunks(later, CANDIDATES):
        owner, offset = expand(later[chunk])
        owner = owner + chunk.start
        one, two = edges.order[owner], edges.order[owner + 1 + offset]
        starts = torch.maximum(edges.first_bucket[one], edges.first_bucket[two])
        first, second = edges.lines[one], edges.lines[two]
        overlap = (second[:, 5] >= first[:, 4]) & (second[:, 4] <= first[:, 5])
        kept = overlap & (starts == bucket[owner]) & (first[:, 5] >= window[0])
        yield one[kept], two[kept]


def _cross(edges: ContourEdges, one: Tensor, two: Tensor) -> tuple[Tensor, ...]:
    """Those pairs that cross, and the share of each edge there."""
    a, b = edges.corners[one].unbind(1)
    c, d = edges.corners[two].unbind(1)
    at_c, at_d = _cross_product(b - a, c - a), _cross_product(b - a, d - a)
    at_a, at_b = _cross_product(d - c, a - c), _cross_product(d - c, b - c)
    apart = (edges.ends[one][:, :, None] != edges.ends[two][:, None, :]).flatten(1).all(-1)
    kept = apart & ((at_c >= 0) != (at_d >= 0)) & ((at_a >= 0) != (at_b >= 0))
    at_a, at_b, at_c, at_d = at_a[kept], at_b[kept], at_c[kept], at_d[kept]
    return one[kept], two[kept], at_a / (at_a - at_b), at_c / (at_c - at_d)


def _clip(edges: ContourEdges, window: Tensor) -> tuple[Tensor, Tensor]:
    """Shares between which edges are in the window; one share where they are not."""
    origin, step = edges.corners[:, 0], edges.corners[:, 1] - edges.corners[:, 0]
    still = step == 0
    divisor = torch.where(still, 1.0, step)
    one, two = (window[:2] - origin) / divisor, (window[2:] - origin) / divisor
    low = torch.where(still, -torch.inf, torch.minimum(one, two)).amax(-1)
    high = torch.where(still, torch.inf, torch.maximum(one, two)).amin(-1)
    outside = (still & ((origin < window[:2]) | (origin > window[2:]))).any(-1)
    begin = low.clamp_min(0.0)
    return begin, torch.where(outside, begin, torch.maximum(high.clamp_max(1.0), begin))


def _is_border(edges: ContourEdges, edge: Tensor, share: Tensor, window: Tensor) -> Tensor:
    """Whether edges have layers on one side only at a share of their length, 0 to 1."""
    corners, own = edges.corners[edge], edges.lines[edge]
    at = corners[:, 0] + share[:, None] * (corners[:, 1] - corners[:, 0])
    flat = own[:, 0] == own[:, 1]
    y = at[:, 1]
    x = torch.where(flat, at[:, 0], own[:, 2] + (y - own[:, 0]) * own[:, 3])
    first, last = window[[1, 3]].floor().long().tolist()
    rows = last - first + 1
    row = (y.floor().long() - first).clamp(0, rows - 1)
    bucket = edges.frame[edge] * rows + row
    query, offset = expand(edges.start[bucket + 1] - edges.start[bucket])
    other = edges.order[edges.start[bucket][query] + offset]
    top, bottom, top_x, slope, low, high = edges.lines[other].unbind(-1)
    here_x, here_y, is_flat = x[query], y[query], flat[query]
    apart = top_x + (here_y - top) * slope - here_x
    active = (other != edge[query]) & (top <= here_y) & (here_y < bottom)
    left = active & (apart < -TOUCH)
    level = is_flat & (top == here_y) & (bottom == here_y) & (low <= here_x) & (here_x < high)
    on_it = (active & ~left & (apart <= TOUCH) & ~is_flat) | (level & (other != edge[query]))
    before = torch.zeros_like(edge).index_add(0, query, torch.where(left, edges.layers[other], 0))
    near = edges.layers[edge].index_add(0, query, torch.where(on_it, edges.layers[other], 0))
    near = torch.where(flat, -near, near)  # the line through a flat edge runs just below it
    return (before > 0) != (before + near > 0)


def _cross_product(one: Tensor, two: Tensor) -> Tensor:
    return one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]


def expand(counts: Tensor) -> tuple[Tensor, Tensor]:
    """List ``counts[i]`` members of each i: the owner of each member and its number, (M,)."""
    counts = counts.clamp_min(0)
    owner = torch.repeat_interleave(counts)
    return owner, torch.arange(len(owner), device=counts.device) - (counts.cumsum(0) - counts)[
        owner
    ]


def chunks(counts: Tensor, most: int) -> Iterator[slice]:
    """At least one slice of consecutive owners, with at most ``most`` members or one owner."""
    total = counts.cumsum(0)
    start, done = 0, 0
    while True:
        limit = torch.searchsorted(total, done + most, right=True)
        stop = min(max(int(limit), start + 1), len(counts))
        yield slice(start, stop)
        if stop >= len(counts):
            return
        start, done = stop, int(total[stop - 1])
