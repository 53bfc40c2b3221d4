"""Slopes of contour energies as functions, and their second derivatives, image by image.

Where a solution is differentiated, the slope of the energy in every Gaussian of an image is a
function of the Gaussians and of the field: the edges and prices that images, or what looks at
them, gave. Pixels are on their own, so a pixel's second derivatives are a 3 x 3 matrix in the
optical depth and its descent; the kernels of ``_density_twice_numba`` do the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.energy import _contour_torch
from perfcap.render.density import LEAST

_PARTS = slice(0, 2), slice(2, 5), 5  # of the six numbers of a Gaussian
_MOST = 1 << 22  # numbers of images that are held at once

Floats = NDArray[np.float64]
Shapes = tuple[Floats, Floats, Floats]
"""Centre (Q, 2), form (Q, 3) and thickness (Q,) of Gaussians in the pixels of a field."""


@dataclass(frozen=True)
class Look:
    """Gaussians of an image, and what its pixels make of them.

    Attributes:
        shapes: the Gaussians.
        images: optical depth and its descent in x and y, (3, H, W).
        field: edges in two numbers and price, (3, H, W).
        pull: derivative of the energy in ``images``, (3, H, W), with a graph to both.
    """

    shapes: Shapes
    images: Tensor
    field: Tensor
    pull: Tensor

    @classmethod
    def at(cls, shapes: Shapes, field: Tensor) -> Look:
        """Of Gaussians and a field (3, H, W) of type float64."""
        from perfcap.render import _density_numba

        drawn = np.zeros(tuple(field.shape))
        _density_numba.draw(*shapes, LEAST, drawn[0], drawn[1:])
        with torch.enable_grad():
            images = torch.from_numpy(drawn).requires_grad_()
            seen = field.detach().requires_grad_()
            energy = _contour_torch.contour(images[0], images[1:], seen[:2], seen[2])
            (pull,) = torch.autograd.grad(energy.sum(), images, create_graph=True)
        return cls(shapes, images, seen, pull)

    def slope(self) -> Tensor:
        """Derivative of the energy in the Gaussians, (Q, 6): centre, form and thickness."""
        return _pulled_back(self.shapes, self.pull.detach().numpy())

    def backward(self, way: Tensor) -> tuple[Tensor, Tensor]:
        """Derivative of ``<way, slope>`` in the Gaussians (Q, 6) and in the field (3, H, W)."""
        moved = self._moved(way[..., None].numpy())[..., 0]
        with torch.enable_grad():
            along = (self.pull * torch.from_numpy(moved)).sum()
        of_images, of_field = torch.autograd.grad(
            along, (self.images, self.field), materialize_grads=True
        )
        bent = (torch.from_numpy(self._bend()) @ way[..., None]).squeeze(-1)
        return _pulled_back(self.shapes, of_images.numpy()) + bent, of_field

    def bend(self, moves: Tensor) -> Tensor:
        """Second derivative (K, K) of the energy along moves (Q, 6, K) of the Gaussians."""
        with torch.enable_grad():
            sums = [part.sum() for part in self.pull]
        rows = [torch.autograd.grad(e, self.images, retain_graph=True)[0] for e in sums]
        pixels = torch.stack(rows).permute(2, 3, 0, 1)  # H W 3 3
        along = moves.contiguous().numpy()
        _, height, width = self.images.shape
        step = max(1, _MOST // max(1, 3 * width * moves.shape[-1]))
        found = (moves.mT @ torch.from_numpy(self._bend()) @ moves).sum(0)
        for first in range(0, height, step):
            moved = torch.from_numpy(self._moved(along, first, min(height, first + step)))
            each = moved.permute(1, 2, 0, 3)  # h W 3 K
            bent = (pixels[first : first + step] @ each).flatten(0, 2)
            found = found + each.flatten(0, 2).mT @ bent
        return found

    def _moved(self, moves: Floats, first: int = 0, stop: int | None = None) -> Floats:
        """How rows of the images change with K moves (Q, 6, K), (3, h, W, K)."""
        from perfcap.render import _density_twice_numba

        _, height, width = self.images.shape
        stop = height if stop is None else stop
        found = np.zeros((3, stop - first, width, moves.shape[-1]))
        centre, form, thickness = self.shapes
        lifted = centre - np.array([0.0, first])
        _density_twice_numba.tangents(lifted, form, thickness, LEAST, moves, found)
        return found

    def _bend(self) -> Floats:
        """Second derivative of the images in each Gaussian, on the pull, (Q, 6, 6)."""
        from perfcap.render import _density_twice_numba

        bent = np.empty((len(self.shapes[2]), 6, 6))
        _density_twice_numba.bend(*self.shapes, LEAST, self.pull.detach().numpy(), bent)
        return bent


def _pulled_back(shapes: Shapes, pull: Floats) -> Tensor:
    """Derivative in Gaussians (Q, 6) of what pulls on their images (3, H, W)."""
    from perfcap.render import _density_numba

    found = tuple(np.empty_like(each) for each in shapes)
    _density_numba.pull_back(*shapes, LEAST, pull[0], pull[1:], *found)
    centre, form, thickness = (torch.from_numpy(each) for each in found)
    return torch.cat((centre, form, thickness[:, None]), -1)


class ImageSlopes(torch.autograd.Function):
    """Slopes of the energy of images in their Gaussians, differentiable once.

    Arguments: Gaussians (I, Q, 6) in the pixels of I fields, and the fields, (3, H, W) each.
    """

    @staticmethod
    def forward(ctx: Any, splats: Tensor, *fields: Tensor) -> Tensor:
        ctx.save_for_backward(splats, *fields)
        looks = (Look.at(_shapes(each[0]), each[1].double()) for each in _pairs(splats, fields))
        return torch.stack([look.slope() for look in looks]).to(splats)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, way: Tensor) -> tuple[Tensor | None, ...]:
        splats, *fields = ctx.saved_tensors
        found = torch.empty_like(splats)
        of_fields: list[Tensor | None] = []
        for index, pair in enumerate(_pairs(splats, fields)):
            look = Look.at(_shapes(pair[0]), pair[1].double())
            found[index], own = look.backward(way[index].double())
            of_fields.append(own.to(pair[1]) if ctx.needs_input_grad[1 + index] else None)
        return found, *of_fields


def bend_images(splats: Tensor, fields: Sequence[Tensor], moves: Tensor) -> Tensor:
    """Second derivative along moves (I, Q, 6, K) of each image's Gaussians (I, Q, 6), (I, K, K)."""
    found = [
        Look.at(_shapes(pair[0]), pair[1].double()).bend(own.double())
        for pair, own in zip(_pairs(splats, fields), moves, strict=True)
    ]
    return torch.stack(found).to(splats)


def _pairs(splats: Tensor, fields: Sequence[Tensor]) -> list[tuple[Tensor, Tensor]]:
    return list(zip(splats, fields, strict=True))


def _shapes(splats: Tensor) -> Shapes:
    whole = splats.detach().double()
    centre, form, thickness = (whole[:, part].contiguous().numpy() for part in _PARTS)
    return centre, form, thickness
