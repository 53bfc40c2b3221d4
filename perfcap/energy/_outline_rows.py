"""Squared differences of images as least squares of few rows: one small matrix an outline edge.

Pixels of the band about a silhouette see two vertices each, those of the nearest outline edge. The
products of all rows that see an edge are 5 by 5 numbers (four coordinates and the residual), and
any square root of them has the same value, gradient and Gauss-Newton curvature as the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.render.soft_silhouette import CoverageDerivative
from perfcap.solve.kernels import Kernel


@dataclass(frozen=True)
class OutlineRows:
    """Residuals of the images of one frame, by outline edge.

    Attributes:
        view: image an edge is in, (E,).
        ends: index of the two vertices of each edge into ``vertices``, (E, 2).
        vertices: those of all edges, (N,).
        products: of the rows (x and y of the first end, x and y of the second, residual) summed
            over the pixels that see an edge, (E, 5, 5).
        rest: squared residuals of pixels that see no edge, (C,).
    """

    view: Tensor
    ends: Tensor
    vertices: Tensor
    products: Tensor
    rest: Tensor

    @classmethod
    def of(cls, derivative: CoverageDerivative, residual: Tensor, scale: Tensor) -> OutlineRows:
        """Rows of images: residual (C, H, W) is ``scale`` (C, H, W) times what coverage is off."""
        flat = residual.flatten()
        pixel = derivative.pixel
        # a pixel with n records is n rows: sqrt(n) times each derivative, residual / sqrt(n). The
        # value and the gradient stay as they are, and the curvature does not get smaller.
        root = torch.bincount(pixel, minlength=len(flat))[pixel].to(flat).sqrt()
        pull = derivative.gradient * (root * scale.flatten()[pixel])[:, None]
        share = derivative.share[:, None]
        rows = torch.cat([(1 - share) * pull, share * pull, (flat[pixel] / root)[:, None]], -1)
        view = pixel // residual[0].numel()
        # one integer an edge: rows of integers take fifty times as long to sort
        first, second = derivative.vertices.unbind(-1)
        count = int(derivative.vertices.max()) + 1 if len(pixel) else 1
        names = (view * count + first) * count + second
        edges, edge = torch.unique(names, return_inverse=True)
        products = rows.new_zeros(len(edges), 25)
        products.index_add_(0, edge, (rows[:, :, None] * rows[:, None, :]).flatten(1))
        pairs = torch.stack([edges // count % count, edges % count], -1)
        vertices, ends = torch.unique(pairs, return_inverse=True)
        unseen = flat.square().index_fill(0, pixel, 0.0)
        rest = unseen.view(len(residual), -1).sum(-1)
        view = edges // (count * count)
        return cls(view, ends, vertices, products.view(-1, 5, 5), rest)

    def pull(self, derivative: Tensor, pixels: Tensor) -> tuple[Tensor, Tensor]:
        """Half the derivative of each view's squared residual, (C, D), and that square, (C,).

        Both are differentiable in the residuals, in the derivative, and to first order in where
        the vertices are.

        Args:
            derivative: of the vertices' pixels in the unknowns, (C, N, 2, D).
            pixels: of the vertices, (C, N, 2).
        """
        view = self.view
        chain = derivative[view.unsqueeze(-1), self.ends].flatten(1, 2)  # E 4 D
        here = pixels[view.unsqueeze(-1), self.ends].flatten(1)  # E 4
        moved = here - here.detach()
        products = self.products
        first = products[:, :4, 4]
        slope = first + (products[:, :4, :4].detach() @ moved.unsqueeze(-1)).squeeze(-1)
        pulled = (chain.mT @ slope.unsqueeze(-1)).squeeze(-1)  # E D
        square = products[:, 4, 4] + 2 * (first.detach() * moved).sum(-1)
        views = len(self.rest)
        none = pulled.new_zeros(views, pulled.shape[-1])
        return none.index_add(0, view, pulled), self.rest.index_add(0, view, square)

    def summed(
        self, camera: Tensor, points: Tensor, kernel: Kernel
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Value (), half gradient (D,) and half curvature (D, D) of all views, reweighted.

        Args:
            camera: derivative of the vertices' pixels in where they are, (C, N, 2, 3).
            points: derivative of the vertices in the unknowns, (N, 3, D).
            kernel: acts on the squared residual of a view.
        """
        strength, value = self._robust(kernel)
        products = strength[self.view, None, None] * self.products  # E 5 5
        # brought to the vertices' places first: each has few rows, however many edges it ends
        chain = camera[self.view.unsqueeze(-1), self.ends]  # E 2 2 3
        blocks = products[:, :4, :4].reshape(-1, 2, 2, 2, 2)
        inner = torch.einsum("eipa,eipjq,ejqb->eiajb", chain, blocks, chain)  # E 2 3 2 3
        pull = torch.einsum("eipa,eip->eia", chain, products[:, :4, 4].reshape(-1, 2, 2))
        ends = self.ends.flatten()
        moved = inner.flatten(1, 2).flatten(2) @ points[ends].view(-1, 6, points.shape[-1])
        square = torch.zeros_like(points).index_add_(0, ends, moved.view(-1, 3, moved.shape[-1]))
        slope = points.new_zeros(len(points), 3).index_add_(0, ends, pull.flatten(0, 1))
        flat = points.flatten(0, 1)
        return value, slope.flatten() @ flat, flat.mT @ square.flatten(0, 1)

    def _robust(self, kernel: Kernel) -> tuple[Tensor, Tensor]:
        """Slope of the kernel at each view (C,), and the value of all."""
        squares = self.rest.index_add(0, self.view, self.products[:, 4, 4])
        return kernel.slope(squares), kernel.value(squares).sum()

    def contract(self, derivative: Tensor) -> Tensor:
        """Products of rows in D other unknowns, (C, D + 1, D + 1), the residual last.

        Args:
            derivative: of the vertices' pixels in the unknowns, (C, N, 2, D).
        """
        unknowns = derivative.shape[-1]
        total = derivative.new_zeros(len(self.rest), unknowns + 1, unknowns + 1)
        for view, square in enumerate(total):
            mine = self.view == view
            chain = derivative[view, self.ends[mine]].flatten(1, 2)  # E 4 D
            products = self.products[mine]
            rows = (products[:, :4, :4] @ chain).flatten(0, 1)
            square[:-1, :-1] = chain.flatten(0, 1).mT @ rows
            square[:-1, -1] = chain.flatten(0, 1).mT @ products[:, :4, 4].flatten()
            square[-1, :-1] = square[:-1, -1]
            square[-1, -1] = self.rest[view] + products[:, 4, 4].sum()
        return total


def square_root(products: Tensor) -> Tensor:
    """Symmetric matrices (..., n, n) whose products with themselves are these."""
    values, vectors = torch.linalg.eigh(products)
    root: Tensor = (vectors * values.clamp_min(0).sqrt().unsqueeze(-2)) @ vectors.mT
    return root
