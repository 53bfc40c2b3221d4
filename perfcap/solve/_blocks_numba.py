"""Products with the curvature of dense blocks as compiled loops, for the CPU.

Says the same as ``_blocks_torch.py``, which tests hold it equal to. The matrix is never formed: a
group of two rows and eight blocks would fill in 36 of its blocks, and a product reads the group's
Jacobian once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel
from perfcap.solve._coarse_numba import add_outer, find_slot
from perfcap.solve.coarse_space import CoarseSpace

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class BlockCurvature:
    """``J' W J``; see ``sparse.Curvature``. ``unknowns`` has q entries of no meaning.

    The length of a tuple is known when the kernels are compiled, and so are the lengths of their
    innermost loops, which are then unrolled.
    """

    blocks: Indices  # (P, G, k), -1 for none
    jacobian: Floats  # (P, G, k, d, q)
    residual: Floats  # (P, G, d)
    weight: Floats  # (P, G)
    unknowns: tuple[int, ...]

    @classmethod
    def of(
        cls, blocks: Tensor, jacobian: Tensor, residual: Tensor, weight: Tensor
    ) -> BlockCurvature:
        """From tensors; contiguous, as another layout would compile the kernels once more."""
        return cls(
            blocks.contiguous().numpy(),
            jacobian.detach().contiguous().numpy(),
            residual.detach().contiguous().numpy(),
            weight.detach().contiguous().numpy(),
            (0,) * jacobian.shape[-1],
        )

    def add_equations(self, gradient: Tensor, diagonal: Tensor) -> None:
        """See ``sparse.Curvature``."""
        _add_equations(
            self.blocks,
            self.jacobian,
            self.residual,
            self.weight,
            gradient.numpy(),
            diagonal.numpy(),
            self.unknowns,
        )

    def add_product(self, direction: Tensor, product: Tensor, running: Tensor) -> None:
        """See ``sparse.Curvature``."""
        _add_product(
            self.blocks,
            self.jacobian,
            self.weight,
            direction.numpy(),
            product.numpy(),
            running.numpy(),
            self.unknowns,
        )

    def add_coarse(self, space: CoarseSpace, matrix: Tensor) -> None:
        """See ``sparse.Curvature``."""
        _add_coarse(
            self.blocks,
            self.jacobian,
            self.weight,
            space.group.numpy(),
            space.modes.numpy(),
            matrix.numpy(),
            (0,) * space.modes.shape[-1],
        )


@kernel()
def _add_equations(
    blocks: Indices,
    jacobian: Floats,
    residual: Floats,
    weight: Floats,
    gradient: Floats,
    diagonal: Floats,
    unknowns: tuple[int, ...],
) -> None:
    problems, groups, slots, rows, _ = jacobian.shape
    for p in range(problems):
        for g in range(groups):
            for a in range(slots if weight[p, g] != 0 else 0):
                i = blocks[p, g, a]
                for r in range(rows if i >= 0 else 0):
                    for c in range(len(unknowns)):
                        scaled = weight[p, g] * jacobian[p, g, a, r, c]
                        gradient[p, i, c] += scaled * residual[p, g, r]
                        for e in range(c + 1):
                            diagonal[p, i, c, e] += scaled * jacobian[p, g, a, r, e]


@kernel()
def _add_product(
    blocks: Indices,
    jacobian: Floats,
    weight: Floats,
    direction: Floats,
    product: Floats,
    running: Flags,
    unknowns: tuple[int, ...],
) -> None:
    """Row by row: the change of the residual, then what it pulls at."""
    problems, groups, slots, rows, _ = jacobian.shape
    for p in range(problems):
        for g in range(groups if running[p] else 0):
            for r in range(rows if weight[p, g] != 0 else 0):
                change = weight[p, g] * 0
                for a in range(slots):
                    i = blocks[p, g, a]
                    for c in range(len(unknowns) if i >= 0 else 0):
                        change += jacobian[p, g, a, r, c] * direction[p, i, c]
                change *= weight[p, g]
                for a in range(slots):
                    i = blocks[p, g, a]
                    for c in range(len(unknowns) if i >= 0 else 0):
                        product[p, i, c] += jacobian[p, g, a, r, c] * change


@kernel()
def _add_coarse(
    blocks: Indices,
    jacobian: Floats,
    weight: Floats,
    group: Indices,
    modes: Floats,
    matrix: Floats,
    counts: tuple[int, ...],
) -> None:
    problems, groups, slots, rows, _ = jacobian.shape
    own, moved = np.empty(slots, np.int64), np.empty((slots, rows, len(counts)), modes.dtype)
    for p in range(problems):
        for g in range(groups):
            used = 0
            for a in range(slots if weight[p, g] != 0 else 0):
                i = blocks[p, g, a]
                if i < 0 or group[i] < 0:
                    continue
                slot = find_slot(own, used, group[i])
                if slot == used:
                    own[slot], moved[slot] = group[i], 0
                    used += 1
                _move(jacobian[p, g, a], modes[p, i], moved[slot], counts)
            add_outer(matrix[p], own, used, moved, weight[p, g], counts)


@inner()
def _move(jacobian: Floats, modes: Floats, moved: Floats, counts: tuple[int, ...]) -> None:
    """Add the derivative in modes (d, r) of one block."""
    for r in range(len(jacobian)):
        for c in range(len(modes)):
            for m in range(len(counts)):
                moved[r, m] += jacobian[r, c] * modes[c, m]
