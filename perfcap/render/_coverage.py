"""Coverage as a function that torch can differentiate; ``soft_silhouette.py`` is its face."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from perfcap.render import _soft_silhouette_reference
from perfcap.render.label_map import NEAR, REACH


@dataclass(frozen=True)
class Borders:
    """A mesh by its edges, and the image to draw it in.

    Attributes:
        faces: triangles of welded vertices, (T, 3).
        face_edges: edge from each corner to the next, (T, 3).
        edge_ends: welded vertices of each edge, the lower first, (E, 2).
        weld: welded vertex of each vertex, (V,), or None.
        share: part of a vertex in its welded vertex, (V,), or None.
        places: U, how many welded vertices there are.
        size: image height and width, px.
        band: half the width of the band about the outline, px.
    """

    faces: Tensor
    face_edges: Tensor
    edge_ends: Tensor
    weld: Tensor | None
    share: Tensor | None
    places: int
    size: tuple[int, int]
    band: float

    def points(self, pixels: Tensor, depth: Tensor) -> Tensor:
        """Welded vertices (B, U, 2) float64 of (B, V, 2), NaN where they cannot be drawn."""
        pixels = pixels.double()
        usable = (pixels.abs() <= REACH).all(-1) & (depth >= NEAR) & torch.isfinite(depth)
        return self.gather(torch.where(usable[..., None], pixels, torch.nan))

    def gather(self, values: Tensor) -> Tensor:
        """Means over the copies of each welded vertex, (B, U, 2) of (B, V, 2)."""
        if self.weld is None or self.share is None:
            return values.contiguous()
        index = self.weld[:, None].expand(values.shape)
        sums = torch.zeros(len(values), self.places, 2, dtype=values.dtype, device=values.device)
        return sums.scatter_add(1, index, values * self.share[:, None])

    def spread(self, gradient: Tensor) -> Tensor:
        """Transpose of ``gather``."""
        if self.weld is None or self.share is None:
            return gradient
        return gradient[:, self.weld] * self.share[:, None]


@dataclass(frozen=True)
class Records:
    """The sparse derivative of coverage; see ``_soft_silhouette_numba.py``.

    Attributes:
        names: pixel, a, b, (N, 3); over B images counted on from image to image.
        values: t, gx, gy, (N, 3).
    """

    names: Tensor
    values: Tensor


def cover(borders: Borders, pixels: Tensor, depth: Tensor) -> tuple[Tensor, Records]:
    """Coverage (B, H, W) of projected vertices (B, V, 2), and its derivative."""
    points = borders.points(pixels, depth)
    mesh = borders.faces, borders.face_edges, borders.edge_ends
    if points.device.type == "cpu":
        return _cover_compiled(borders, points, pixels.dtype)
    drawn = _soft_silhouette_reference.draw(points, *mesh, borders.band, borders.size)
    return drawn[0].to(pixels.dtype), Records(*drawn[1:])


def _cover_compiled(borders: Borders, points: Tensor, dtype: torch.dtype) -> tuple[Tensor, Records]:
    from perfcap.render import _soft_silhouette_numba

    height, width = borders.size
    coverage = torch.zeros(len(points), height, width, dtype=_compiled_for(dtype))
    faces, face_edges, edge_ends = (
        each.numpy() for each in (borders.faces, borders.face_edges, borders.edge_ends)
    )
    strides = torch.tensor([height * width, borders.places, borders.places])
    names, values = [torch.zeros(0, 3, dtype=torch.int64)], [torch.zeros(0, 3, dtype=torch.float64)]
    for index, (frame, image) in enumerate(zip(points.numpy(), coverage.numpy(), strict=True)):
        found = _soft_silhouette_numba.draw(
            frame, faces, face_edges, edge_ends, borders.band, image
        )
        names.append(torch.from_numpy(found[0]) + index * strides)
        values.append(torch.from_numpy(found[1]))
    return coverage.to(dtype), Records(torch.cat(names), torch.cat(values))


def _compiled_for(dtype: torch.dtype) -> torch.dtype:
    """The precision kernels compute images of this one in."""
    return dtype if dtype in (torch.float32, torch.float64) else torch.float32


def pull_back(borders: Borders, records: Records, gradient: Tensor) -> Tensor:
    """Gradient of vertices (B, V, 2) float64 from that of coverage, (B, H, W)."""
    images = gradient.numel() // math.prod(borders.size)
    points = records.values.new_zeros(images * borders.places, 2)
    flat = gradient.reshape(-1).contiguous()
    if flat.device.type == "cpu":
        from perfcap.render import _soft_silhouette_numba

        flat = flat.to(_compiled_for(flat.dtype))
        arrays = (each.numpy() for each in (records.names, records.values, flat, points))
        _soft_silhouette_numba.pull_back(*arrays)
    else:
        _soft_silhouette_reference.pull_back(records.names, records.values, flat, points)
    return borders.spread(points.view(images, borders.places, 2))


def push_forward(borders: Borders, records: Records, tangent: Tensor) -> Tensor:
    """Derivative of the records' pixels (N,) along one of vertices, (B, V, 2).

    A pixel that has two records changes by the sum of both.
    """
    moved = borders.gather(tangent.to(records.values.dtype)).reshape(-1, 2)
    a, b = moved[records.names[:, 1]], moved[records.names[:, 2]]
    return (records.values[:, 1:] * torch.lerp(a, b, records.values[:, :1])).sum(-1)


class Coverage(torch.autograd.Function):
    """Coverage (*b, H, W) of vertices (*b, V, 2), and its records, which have no derivative."""

    @staticmethod
    def forward(pixels: Tensor, depth: Tensor, borders: Borders) -> tuple[Tensor, Tensor, Tensor]:
        """Draw all images."""
        batch, vertices = depth.shape[:-1], depth.shape[-1]
        flat = pixels.reshape(-1, vertices, 2), depth.reshape(-1, vertices)
        coverage, records = cover(borders, *flat)
        return coverage.view(*batch, *borders.size), records.names, records.values

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, ...]) -> None:
        """Keep the records."""
        coverage, *records = output
        ctx.mark_non_differentiable(*records)
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*records)
        ctx.save_for_forward(*records)
        ctx.borders, ctx.shape, ctx.image = inputs[2], tuple(inputs[0].shape), coverage.shape

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor | None) -> tuple[Tensor | None, None, None]:
        """Gradient of the vertices."""
        if gradients[0] is None:
            return None, None, None
        kept = *ctx.saved_tensors, ctx.borders, ctx.shape
        gradient: Tensor = _PullBack.apply(gradients[0], *kept)  # type: ignore[no-untyped-call]
        return gradient, None, None

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> tuple[Tensor | None, None, None]:
        """Derivative of coverage along one of the vertices."""
        if tangents[0] is None:
            return None, None, None
        records = Records(*ctx.saved_tensors)
        flat = tangents[0].reshape(-1, *ctx.shape[-2:])
        change = push_forward(ctx.borders, records, flat)
        total = torch.zeros(ctx.image.numel(), dtype=change.dtype, device=change.device)
        total = total.index_add(0, records.names[:, 0], change)
        return total.view(ctx.image).to(tangents[0].dtype), None, None

    @staticmethod
    def vmap(*_: Any) -> tuple[Any, Any]:
        """There is none: images have different numbers of records."""
        raise RuntimeError("SoftSilhouette has no vmap over its input; give it a batch instead")


class _PullBack(torch.autograd.Function):
    """Gradient of vertices from that of coverage; has no derivative of its own."""

    @staticmethod
    def forward(
        gradient: Tensor, names: Tensor, values: Tensor, borders: Borders, shape: tuple[int, ...]
    ) -> Tensor:
        result = pull_back(borders, Records(names, values), gradient)
        return result.view(shape).to(gradient.dtype)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        """Nothing is kept, as there is no derivative."""

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> None:
        raise RuntimeError(
            "SoftSilhouette has no second derivative; use a first-order or Gauss-Newton method"
        )

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> None:
        _PullBack.backward(ctx)

    @staticmethod
    def vmap(
        info: Any,
        in_dims: tuple[int | None, ...],
        gradient: Tensor,
        names: Tensor,
        values: Tensor,
        borders: Borders,
        shape: tuple[int, ...],
    ) -> tuple[Tensor, int]:
        """One after the other: what ``jacrev`` asks for."""
        every = [
            _PullBack.apply(one, names, values, borders, shape)  # type: ignore[no-untyped-call]
            for one in gradient.unbind(in_dims[0] or 0)
        ]
        return torch.stack(every), 0
