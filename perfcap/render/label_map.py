"""Which triangle does each pixel see? A hard z-buffer.

Coordinates are pixels with centres at integers, depth is in metres along the camera's z axis.
Vertices are snapped to 1/4096 pixel, after which coverage is exact integer arithmetic with the
top-left rule: a pixel centre on an edge shared by two triangles belongs to exactly one of them
(Pineda 1988). Depth is perspective correct: 1/z is linear in the image.

Left out are triangles with a vertex nearer than ``NEAR`` (5 cm: nothing is clipped, since a person
that close is not captured), with a vertex further than ``REACH`` pixels from the origin, with a
vertex that is not finite, and those without area.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.render import _zbuffer_numba, _zbuffer_reference

Box = tuple[slice, slice]

NEAR = 0.05  # m
BITS = 12  # fractional bits of the pixel grid
REACH = 1 << 17  # px; with BITS and LARGEST it keeps every edge value below 2^62
LARGEST = 1 << 14  # px, longest image side


class Cull(enum.Enum):
    """Triangles to leave out; the value is their area's sign in the image (y down)."""

    NONE = 0
    BACK = 1
    FRONT = -1


@dataclass(frozen=True)
class LabelMap:
    """Nearest surface at each pixel centre.

    Attributes:
        depth: (*b, H, W) metres, inf where nothing is seen.
        triangle: (*b, H, W) int32 face index, -1 where nothing is seen.
        corner: row and column in the image of the first pixel, of a part of an image.
    """

    depth: Tensor
    triangle: Tensor
    corner: tuple[int, int] = (0, 0)

    @property
    def mask(self) -> Tensor:
        """(*b, H, W) bool, True where a surface is seen."""
        return self.triangle >= 0

    def label(self, face_labels: Tensor, background: int = 0) -> Tensor:
        """Label of the face each pixel sees, (*b, H, W), of the dtype of ``face_labels`` (T,).

        Labels are parts, people or anything else; a scene of several meshes is one mesh whose
        face indices were offset.

        Raises:
            InputError: ``face_labels`` are of a type that has no such number as the background.
        """
        empty = face_labels.new_full((1,), background)
        held = torch.tensor(background).to(face_labels.dtype).item()
        if held != background:
            raise InputError(
                f"background is {background}, which {face_labels.dtype} does not have: it would be "
                f"{held}; give face_labels of another type, as face_labels.int()"
            )
        return torch.cat([face_labels, empty])[self.triangle.long()]  # -1 is the last entry

    def barycentric(self, pixels: Tensor, depth: Tensor, faces: Tensor) -> Tensor:
        """Perspective-correct weights of the seen face's corners, (*b, H, W, 3), zero where empty.

        Args are those of ``rasterize``. Differentiable in pixels and depth.
        """
        shift = torch.tensor(self.corner[::-1], device=self.triangle.device)
        *frame, row, column = torch.nonzero(self.mask, as_tuple=True)
        face = faces.long()[self.triangle[(*frame, row, column)].long()]
        where = tuple(axis[:, None] for axis in frame)
        weights = barycentric_at(
            (torch.stack([column, row], -1) + shift).to(pixels),
            pixels[(*where, face)],
            depth[(*where, face)],
        )
        out = weights.new_zeros(*self.mask.shape, 3)
        return out.index_put((*frame, row, column), weights)


def rasterize(
    pixels: Tensor,
    depth: Tensor,
    faces: Tensor,
    size: tuple[int, int],
    cull: Cull = Cull.NONE,
    part: Box | None = None,
) -> LabelMap:
    """Draw a mesh, or one mesh in many frames, into label maps.

    Args:
        pixels: projected vertices, (*b, V, 2) px, pixel centres at integers.
        depth: depth of the vertices along the optical axis, (*b, V) m.
        faces: (T, 3), counter-clockwise seen from outside.
        size: image height and width, px.
        cull: ``BACK`` leaves out faces seen from behind, ``FRONT`` those seen from outside
            (what remains is the far side of a closed surface).
        part: rows and columns of the image to draw, which then are H and W: pixels are as in the
            whole image, at less time and memory. ``surrounding`` finds those that a mesh needs.

    Returns:
        Label maps (*b, H, W); ``depth`` has the dtype of ``depth``. On the CPU a compiled kernel
        draws, one frame after the other and on one thread; elsewhere its torch twin.

    Raises:
        InputError: shapes that do not fit, face indices out of range, an image too large.
    """
    _check(pixels, depth, faces, size)
    rows, columns = _within(part, size)
    corner, shape = (
        (rows.start, columns.start),
        (rows.stop - rows.start, columns.stop - columns.start),
    )
    batch, vertices = depth.shape[:-1], depth.shape[-1]
    count = batch.numel()
    grid, inverse, usable = snap(pixels.detach(), depth.detach())
    grid = grid - (torch.tensor(corner[::-1], device=grid.device) << BITS)
    nearest = torch.full((count, *shape), torch.inf, dtype=torch.float64, device=depth.device)
    triangle = torch.full((count, *shape), -1, dtype=torch.int32, device=depth.device)
    faces = faces.detach().to(torch.int64).contiguous()
    frames = zip(
        grid.reshape(count, vertices, 2),
        inverse.reshape(count, vertices),
        usable.reshape(count, vertices),
        nearest,
        triangle,
        strict=True,
    )
    for points, reciprocal, kept, surface, index in frames:
        draw(points, reciprocal, kept, faces, cull, surface, index)
    drawn = nearest.to(depth.dtype).view(*batch, *shape), triangle.view(*batch, *shape)
    return LabelMap(*drawn, corner)


def cover(
    pixels: Tensor, depth: Tensor, faces: Tensor, size: tuple[int, int], part: Box | None = None
) -> Tensor:
    """Where a mesh in one frame is seen at all, (H, W) bool: the mask of its label map, no more.

    Args are those of ``rasterize``, of pixels (V, 2) and depth (V,). On the CPU it takes less than
    half the time, and an eighth of the memory.
    """
    _check(pixels, depth, faces, size)
    rows, columns = _within(part, size)
    if depth.device.type != "cpu":
        return rasterize(pixels, depth, faces, size, part=part).mask
    grid, _, usable = snap(pixels.detach(), depth.detach())
    grid -= torch.tensor((columns.start, rows.start)) << BITS
    covered = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.uint8)
    corners = faces.detach().to(torch.int64).contiguous().numpy()
    _zbuffer_numba.cover(grid.numpy(), usable.numpy(), corners, BITS, covered)
    return torch.from_numpy(covered.view(np.bool_))


def surrounding(pixels: Tensor, depth: Tensor, size: tuple[int, int], margin: int) -> Box:
    """Rows and columns of an image that vertices lie in, with a margin; one pixel at the least.

    Args:
        pixels: projected vertices, (V, 2) px; those that no triangle is drawn with do not count.
        depth: along the optical axis, (V,) m.
        size: image height and width, px.
        margin: px that are added on every side, as far as the image goes.
    """
    pixels, depth = pixels.detach().double().cpu(), depth.detach().double().cpu()
    sides = _zbuffer_numba.extent(pixels.numpy(), depth.numpy(), (REACH, NEAR))
    if not np.isfinite(sides).all():
        return slice(0, 1), slice(0, 1)
    low = [int(np.floor(side)) - margin for side in sides[::2]]
    high = [int(np.ceil(side)) + margin for side in sides[1::2]]
    first = [min(max(low[axis], 0), size[1 - axis] - 1) for axis in range(2)]
    last = [min(max(high[axis], first[axis]), size[1 - axis] - 1) for axis in range(2)]
    return slice(first[1], last[1] + 1), slice(first[0], last[0] + 1)


def draw(
    grid: Tensor,
    inverse_depth: Tensor,
    usable: Tensor,
    faces: Tensor,
    cull: Cull,
    depth: Tensor,
    triangle: Tensor,
) -> None:
    """Draw one snapped frame in place into ``depth`` (H, W) float64 and ``triangle`` (H, W)."""
    if depth.device.type != "cpu":
        mesh = (grid, inverse_depth, usable, faces)
        _zbuffer_reference.fill(*mesh, cull.value, BITS, depth, triangle)
        return
    arrays = [each.numpy() for each in (grid, inverse_depth, usable, faces)]
    _zbuffer_numba.fill(*arrays, cull.value, BITS, depth.numpy(), triangle.numpy())


def snap(pixels: Tensor, depth: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Vertices on the integer grid (*b, V, 2), inverse depth (*b, V) 1/m, and usable (*b, V)."""
    pixels, depth = pixels.double(), depth.double()
    if depth.device.type == "cpu":
        grid = torch.empty(pixels.shape, dtype=torch.int64)
        inverse, usable = torch.empty_like(depth), torch.empty(depth.shape, dtype=torch.bool)
        rows = [each.flatten(0, depth.dim() - 1).contiguous() for each in (pixels, depth)]
        out = grid.view(-1, 2), inverse.view(-1), usable.view(-1)
        _zbuffer_numba.snap(
            *(row.numpy() for row in rows),
            *((REACH, NEAR), float(1 << BITS)),
            *(each.numpy() for each in out),
        )
        return grid, inverse, usable
    usable = usable_vertices(pixels, depth)
    return *_zbuffer_reference.snap(pixels, depth, usable, BITS), usable


def usable_vertices(pixels: Tensor, depth: Tensor) -> Tensor:
    """Vertices (*b, V) whose triangles can be drawn."""
    return (pixels.abs() <= REACH).all(-1) & (depth >= NEAR) & torch.isfinite(depth)


def barycentric_at(points: Tensor, corners: Tensor, depth: Tensor) -> Tensor:
    """Perspective-correct weights (N, 3) of triangles at image points inside them.

    Weights are clamped to the triangle and sum to one, so that points which only snapping put
    inside do not extrapolate; a triangle without area returns its corners' mean.

    Args:
        points: (N, 2) px.
        corners: (N, 3, 2) px.
        depth: corners' depth, (N, 3) m.
    """
    towards = corners - points[:, None]
    after, last = towards.roll(-1, 1), towards.roll(-2, 1)
    areas = after[..., 0] * last[..., 1] - after[..., 1] * last[..., 0]  # N 3
    total = areas.sum(-1, keepdim=True)
    flat = total == 0
    linear = torch.where(flat, 1 / 3, areas / torch.where(flat, 1.0, total)).clamp_min(0)
    perspective = linear / depth
    return perspective / perspective.sum(-1, keepdim=True)


def _within(part: Box | None, size: tuple[int, int]) -> Box:
    """A part of an image as it is; the whole image if None."""
    if part is None:
        return slice(0, size[0]), slice(0, size[1])
    for rows, side in zip(part, size, strict=True):
        if not 0 <= rows.start < rows.stop <= side:
            raise InputError(
                f"part is {part}; expected rows and columns within an image of {size} pixels"
            )
    return part


def _check(pixels: Tensor, depth: Tensor, faces: Tensor, size: tuple[int, int]) -> None:
    if pixels.shape != (*depth.shape, 2):
        raise InputError(
            f"pixels has shape {tuple(pixels.shape)} but depth {tuple(depth.shape)}; "
            "expected (*b, V, 2) and (*b, V)"
        )
    if faces.ndim != 2 or faces.shape[-1] != 3 or faces.is_floating_point():
        raise InputError(
            f"faces has shape {tuple(faces.shape)} and dtype {faces.dtype}; "
            "expected integers (T, 3)"
        )
    if len(faces) and not 0 <= int(faces.min()) <= int(faces.max()) < depth.shape[-1]:
        raise InputError(
            f"faces refers to vertices {int(faces.min())} to {int(faces.max())} but there are "
            f"{depth.shape[-1]}; expected indices into pixels"
        )
    require_image_size(size)
    if pixels.is_meta or depth.is_meta or faces.is_meta:
        raise InputError(
            "pixels, depth or faces are on the meta device, which holds no numbers; expected cpu "
            "or cuda"
        )


def require_image_size(size: Sequence[Any]) -> None:
    """Refuse what is no size of an image in whole pixels.

    Raises:
        InputError: it is something else.
    """
    whole = len(size) == 2 and all(isinstance(side, Integral) for side in size)
    if not whole or not all(1 <= side <= LARGEST for side in size):
        raise InputError(
            f"size is {size!r:.80}; expected height and width from 1 to {LARGEST} pixels, whole "
            "numbers"
        )
