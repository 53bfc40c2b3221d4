"""Hard z-buffer in plain torch: the statement that the numba kernel is held to, and the GPU path.

Every triangle lists the pixels of its bounding box, pixels inside are kept, and two scattered
minima (depth, then triangle index among equals) resolve visibility in any order.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

CANDIDATES = 1 << 22  # pixels tested at once: about 0.5 GB of intermediates in float64


def fill(
    grid: Tensor,
    inverse_depth: Tensor,
    usable: Tensor,
    faces: Tensor,
    culled_sign: int,
    bits: int,
    depth: Tensor,
    triangle: Tensor,
) -> None:
    """Draw triangles into ``depth`` and ``triangle``; arguments as in the numba kernel."""
    height, width = depth.shape
    index, low, count = _boxes(grid, usable, faces, culled_sign, bits, (height, width))
    for chunk in _chunks(count.prod(-1)):
        owner, pixel = _candidates(low[chunk], count[chunk])
        here, inside = _depth_at(grid, inverse_depth, faces[index[chunk]], owner, pixel << bits)
        flat = (pixel[:, 1] * width + pixel[:, 0])[inside]
        _resolve(flat, here[inside], index[chunk][owner[inside]], depth.view(-1), triangle.view(-1))


def snap(pixels: Tensor, depth: Tensor, usable: Tensor, bits: int) -> tuple[Tensor, Tensor]:
    """Usable vertices on the grid (*b, V, 2), and their inverse depth (*b, V)."""
    grid = torch.where(usable[..., None], pixels, 0.0).mul(1 << bits).round().long()
    return grid, torch.where(usable, depth, 1.0).reciprocal()


def _boxes(
    grid: Tensor, usable: Tensor, faces: Tensor, culled_sign: int, bits: int, size: tuple[int, int]
) -> tuple[Tensor, Tensor, Tensor]:
    """Triangles that can cover a pixel: index (N,), first pixel (N, 2) and box size (N, 2), x y."""
    corners = grid[faces]  # T 3 2
    last = torch.tensor([size[1] - 1, size[0] - 1], device=grid.device)
    low = ((corners.amin(1) + (1 << bits) - 1) >> bits).clamp_min(0)
    count = torch.minimum(corners.amax(1) >> bits, last) - low + 1
    area = _cross(corners[:, 0], corners[:, 1], corners[:, 2])
    keep = usable[faces].all(-1) & (count > 0).all(-1) & (area != 0)
    index = torch.nonzero(keep & (area.sign() * culled_sign <= 0)).squeeze(-1)
    return index, low[index], count[index]


def _chunks(areas: Tensor) -> Iterator[slice]:
    """Slices of consecutive boxes with at most CANDIDATES pixels, or a single larger box."""
    start, total = 0, 0
    for position, area in enumerate(areas.tolist()):
        if total + area > CANDIDATES and position > start:
            yield slice(start, position)
            start, total = position, 0
        total += area
    if len(areas) > start:
        yield slice(start, len(areas))


def _candidates(low: Tensor, count: Tensor) -> tuple[Tensor, Tensor]:
    """All pixels of all boxes: box number (P,) and pixel x y (P, 2)."""
    area = count.prod(-1)
    owner = torch.repeat_interleave(area)
    offset = torch.arange(len(owner), device=low.device) - (area.cumsum(0) - area)[owner]
    width = count[owner, 0]
    inside_box = torch.stack([offset % width, offset // width], -1)
    return owner, low[owner] + inside_box


def _depth_at(
    grid: Tensor, inverse: Tensor, faces: Tensor, owner: Tensor, point: Tensor
) -> tuple[Tensor, Tensor]:
    """Depth (P,) of each box's triangle at grid points (P, 2), and whether the point is inside."""
    corners = grid[faces]
    turned = _cross(corners[:, 0], corners[:, 1], corners[:, 2]) < 0
    faces = torch.where(turned[:, None], faces[:, [0, 2, 1]], faces)
    a, b, c = grid[faces[owner]].unbind(1)
    edges = ((b, c), (c, a), (a, b))
    values = [_cross(start, end, point) for start, end in edges]
    pairs = zip(values, edges, strict=True)
    inside = torch.stack([value >= _least(*edge) for value, edge in pairs]).all(0)
    weights = inverse[faces[owner]].unbind(1)
    blend = values[0] * weights[0] + values[1] * weights[1] + values[2] * weights[2]
    return _cross(a, b, c) / blend, inside


def _resolve(pixel: Tensor, here: Tensor, index: Tensor, depth: Tensor, triangle: Tensor) -> None:
    """Keep the nearest fragment of each pixel in place; of equals the lowest triangle index."""
    before = depth.clone()
    depth.scatter_reduce_(0, pixel, here, "amin")
    triangle[depth < before] = torch.iinfo(torch.int32).max
    wins = (here == depth[pixel]) & (here < before[pixel])
    triangle.scatter_reduce_(0, pixel[wins], index[wins].to(torch.int32), "amin")


def _cross(start: Tensor, end: Tensor, point: Tensor) -> Tensor:
    """Twice the signed area of start, end, point, all (..., 2)."""
    along, across = end - start, point - start
    return along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0]


def _least(start: Tensor, end: Tensor) -> Tensor:
    """Smallest edge value that counts as inside: 0 on top and left edges, 1 on the others."""
    along = end - start
    rises = (along[..., 1] < 0) | ((along[..., 1] == 0) & (along[..., 0] > 0))
    return (~rises).to(torch.int64)
