"""Soft silhouettes in plain torch: what the numba kernel is held to, and the GPU path.

Every piece of the outline lists the pixels of its band; one scattered minimum over keys that hold
distance above piece number finds the nearest piece of each pixel. See
``_soft_silhouette_numba.py`` for the method and for what a record is.
"""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.render._outline_reference import (
    ContourEdges,
    Outline,
    chunks,
    contour_edges,
    expand,
    outlines,
)

PARALLEL = 1e-6  # sine of an angle; where edges cross at less, the crossing is held fixed
NEAREST = 1e-9  # px, below this the direction to the outline is that of its normal
CANDIDATES = 1 << 22  # pixels tested at once: about 0.5 GB of intermediates


def draw(
    points: Tensor,
    faces: Tensor,
    face_edges: Tensor,
    edge_ends: Tensor,
    band: float,
    size: tuple[int, int],
) -> tuple[Tensor, Tensor, Tensor]:
    """Draw all frames.

    Args:
        points: (F, U, 2) px float64, NaN for vertices whose triangles are left out.
        faces: (T, 3).
        face_edges: edge from each corner to the next, (T, 3).
        edge_ends: vertices of each edge, the lower first, (E, 2).
        band: half its width, px.
        size: image height and width, px.

    Returns:
        Coverage (F, H, W) float64; records: pixel, a, b (N, 3), and t, gx, gy (N, 3), where
        pixels and vertices of frame f are counted on from f * H * W and f * U.
    """
    height, width = size
    window = points.new_tensor([-band, -band, width - 1 + band, height - 1 + band])
    edges = contour_edges(points, faces, face_edges, edge_ends, window)
    outline = outlines(edges, window)
    covered = _covered(edges, window, (len(points), height, width))
    pixel, piece = _nearest_pieces(outline, band, covered)
    inside = covered.view(-1)[pixel]
    level, along, gradient = _look(outline.lines[piece], pixel, inside, band, size)
    coverage = covered.to(points.dtype)
    coverage.view(-1)[pixel] = level
    return coverage, *_records(points.view(-1, 2), outline, pixel, piece, along, gradient)


def _covered(edges: ContourEdges, window: Tensor, shape: tuple[int, int, int]) -> Tensor:
    """Whether pixel centres are covered, (F, H, W) bool."""
    frames, height, width = shape
    top, bottom = edges.lines[:, 0], edges.lines[:, 1]
    first = top.ceil().clamp_min(0).long()
    last = (bottom.ceil().long() - 1).clamp_max(height - 1)
    edge, offset = expand(last - first + 1)
    row = first[edge] + offset
    x = edges.lines[edge, 2] + (row - top[edge]) * edges.lines[edge, 3]
    column = x.ceil().clamp(0, width).long()
    added = torch.zeros(frames * height * (width + 1), dtype=torch.int32, device=top.device)
    place = (edges.frame[edge] * height + row) * (width + 1) + column
    added.index_add_(0, place, edges.layers[edge].to(torch.int32))
    return added.view(frames, height, width + 1)[..., :-1].cumsum(-1, dtype=torch.int32) > 0


def _nearest_pieces(outline: Outline, band: float, covered: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels of the band (B,), ascending, and the nearest piece of each (B,)."""
    _, height, width = covered.shape
    key = torch.full(
        (covered.numel(),), torch.iinfo(torch.int64).max, dtype=torch.int64, device=covered.device
    )
    piece, row, left, count = _spans(outline, band, (height, width))
    for chunk in chunks(count, CANDIDATES):
        span, offset = expand(count[chunk])
        span = span + chunk.start
        column = left[span] + offset
        gap, _ = _gap(outline.lines[piece[span]], column, row[span])
        squared = gap[:, 0] * gap[:, 0] + gap[:, 1] * gap[:, 1]
        near = squared < band * band
        place = (outline.frame[piece[span]] * height + row[span]) * width + column
        # bits of a positive float are ordered as it is; ties go to the lower piece
        bits = squared.float().view(torch.int32).long()
        candidate = (bits << 32) | piece[span]
        key.scatter_reduce_(0, place[near], candidate[near], "amin")
    (pixel,) = torch.nonzero(key != torch.iinfo(torch.int64).max, as_tuple=True)
    return pixel, key[pixel] & 0xFFFFFFFF


def _spans(
    outline: Outline, band: float, size: tuple[int, int]
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Rows of the band of each piece: piece, row, first column, number of columns, (S,)."""
    x0, y0, dx, dy, _ = outline.lines.unbind(-1)
    low, high = torch.minimum(y0, y0 + dy) - band, torch.maximum(y0, y0 + dy) + band
    first = low.ceil().clamp_min(0).long()
    piece, offset = expand(high.floor().clamp_max(size[0] - 1).long() - first + 1)
    row = first[piece] + offset
    x0, y0, dx, dy = (each[piece] for each in (x0, y0, dx, dy))
    level = dy == 0
    divisor = torch.where(level, 1.0, dy)
    one, two = (row - band - y0) / divisor, (row + band - y0) / divisor
    begin = torch.where(level, 0.0, torch.minimum(one, two).clamp_min(0.0))
    finish = torch.where(level, 1.0, torch.maximum(one, two).clamp_max(1.0))
    one, two = x0 + begin * dx, x0 + finish * dx
    left = (torch.minimum(one, two) - band).ceil().clamp_min(0).long()
    right = (torch.maximum(one, two) + band).floor().clamp_max(size[1] - 1).long()
    return piece, row, left, (right - left + 1).clamp_min(0)


def _gap(lines: Tensor, column: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Vectors from the nearest points of pieces to pixels (N, 2), and the shares there (N,)."""
    x0, y0, dx, dy, squared = lines.unbind(-1)
    off_x, off_y = column - x0, row - y0
    along = ((off_x * dx + off_y * dy) / squared).clamp(0.0, 1.0)
    return torch.stack([off_x - along * dx, off_y - along * dy], -1), along


def _look(
    lines: Tensor, pixel: Tensor, inside: Tensor, band: float, size: tuple[int, int]
) -> tuple[Tensor, Tensor, Tensor]:
    """Coverage of pixels, share of the piece each sees, derivative in the point seen (B, 2)."""
    gap, along = _gap(lines, pixel % size[1], pixel // size[1] % size[0])
    distance = (gap[:, 0] * gap[:, 0] + gap[:, 1] * gap[:, 1]).sqrt()
    side = torch.where(inside, 1.0, -1.0).to(distance)
    level = (0.5 + 0.5 * side * distance / band).clamp(0.0, 1.0)
    slope = 3.0 * level * (1.0 - level) / band
    on_it = distance <= NEAREST
    towards = gap * (-side * slope / torch.where(on_it, 1.0, distance))[:, None]
    right = torch.stack([lines[:, 3], -lines[:, 2]], -1) * (slope / lines[:, 4].sqrt())[:, None]
    gradient = torch.where(on_it[:, None], right, towards)
    return level * level * (3.0 - 2.0 * level), along, gradient


def _records(
    points: Tensor, outline: Outline, pixel: Tensor, piece: Tensor, along: Tensor, gradient: Tensor
) -> tuple[Tensor, Tensor]:
    """One record for each pixel of the band, and another for each that sees a crossing."""
    vertices, shares = outline.vertices[piece], outline.shares[piece]
    end = (along == 1.0).long()
    clamped = (along == 0.0) | (along == 1.0)
    one = torch.arange(len(pixel), device=pixel.device)
    inner = shares[:, 0] + along * (shares[:, 1] - shares[:, 0])
    share = torch.where(clamped, shares[one, end], inner)
    other = torch.stack([vertices[one, 2 + 2 * end], vertices[one, 3 + 2 * end]], -1)
    mine = _normal(points, vertices[:, :2])
    theirs = _normal(points, other.clamp_min(0))
    sine = mine[:, 0] * theirs[:, 1] - mine[:, 1] * theirs[:, 0]
    split = clamped & (other[:, 0] >= 0) & ~(sine.abs() < PARALLEL)
    divisor = torch.where(split, sine, 1.0)
    own = (gradient[:, 0] * theirs[:, 1] - gradient[:, 1] * theirs[:, 0]) / divisor
    rest = (mine[:, 0] * gradient[:, 1] - mine[:, 1] * gradient[:, 0]) / divisor
    gradient = torch.where(split[:, None], own[:, None] * mine, gradient)
    names = torch.cat([pixel[:, None], vertices[:, :2]], -1)
    values = torch.cat([share[:, None], gradient], -1)
    more_names = torch.cat([pixel[:, None], other], -1)[split]
    more_values = torch.cat([shares[one, 2 + end][:, None], rest[:, None] * theirs], -1)[split]
    return torch.cat([names, more_names]), torch.cat([values, more_values])


def _normal(points: Tensor, vertices: Tensor) -> Tensor:
    """Unit normals to the right-hand side of edges (B, 2)."""
    dx, dy = (points[vertices[:, 1]] - points[vertices[:, 0]]).unbind(-1)
    length = (dx * dx + dy * dy).sqrt()
    return torch.stack([-dy / length, dx / length], -1)


def pull_back(names: Tensor, values: Tensor, gradient: Tensor, points: Tensor) -> None:
    """Add the gradient of pixels (F * H * W,) to that of points (F * U, 2), in place."""
    here = gradient[names[:, 0]].to(values.dtype)[:, None] * values[:, 1:]  # N 2
    points.index_add_(0, names[:, 1], (1.0 - values[:, :1]) * here)
    points.index_add_(0, names[:, 2], values[:, :1] * here)
