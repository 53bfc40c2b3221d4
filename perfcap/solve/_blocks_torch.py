"""Products with the curvature of dense blocks in torch: for GPUs, and what the kernels must equal.

See ``_blocks_numba.py`` for the same as compiled loops.
"""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.solve._coarse_torch import add_outer
from perfcap.solve.coarse_space import CoarseSpace


class BlockCurvature:
    """``J' W J``; see ``sparse.Curvature``.

    Args:
        blocks: (P, G, k), -1 for none.
        jacobian: (P, G, k, d, q).
        residual: (P, G, d).
        weight: (P, G).
    """

    def __init__(self, blocks: Tensor, jacobian: Tensor, residual: Tensor, weight: Tensor) -> None:
        self.blocks = blocks.clamp(min=0)
        seen = ((blocks >= 0) & (weight != 0)[..., None])[..., None, None]
        # a weight of zero takes a group out, whatever its numbers are
        self.jacobian = torch.where(seen, jacobian, 0)
        self.pull = torch.where(weight[..., None] != 0, weight[..., None] * residual, 0)
        self.weight = weight

    def add_equations(self, gradient: Tensor, diagonal: Tensor) -> None:
        """See ``sparse.Curvature``."""
        self._scatter(gradient, torch.einsum("pgkdq,pgd->pgkq", self.jacobian, self.pull))
        weighted = self.weight[..., None, None, None] * self.jacobian
        self._scatter(diagonal, (weighted.mT @ self.jacobian).tril())

    def add_product(self, direction: Tensor, product: Tensor, running: Tensor) -> None:
        """See ``sparse.Curvature``."""
        slots = self.blocks.flatten(1)[..., None].expand(-1, -1, direction.shape[-1])
        seen = direction.gather(1, slots).reshape(*self.blocks.shape, -1)
        moved = torch.einsum("pgkdq,pgkq->pgd", self.jacobian, seen)
        pull = self.weight[..., None] * moved
        self._scatter(product, torch.einsum("pgkdq,pgd->pgkq", self.jacobian, pull))

    def add_coarse(self, space: CoarseSpace, matrix: Tensor) -> None:
        """See ``sparse.Curvature``."""
        problems = torch.arange(len(matrix), device=matrix.device)[:, None, None]
        rows = self.jacobian @ space.modes[problems, self.blocks]
        add_outer(matrix, space.group[self.blocks], rows, self.weight)

    def _scatter(self, out: Tensor, parts: Tensor) -> None:
        """Add parts (P, G, k, ...) to the blocks of (P, M, ...) that they belong to."""
        problems, blocks = out.shape[:2]
        first = blocks * torch.arange(problems, device=out.device)
        place = (first[:, None, None] + self.blocks).flatten()
        out.view(problems * blocks, *out.shape[2:]).index_add_(0, place, parts.flatten(0, 2))
