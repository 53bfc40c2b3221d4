"""The capacitance matrix of window energies and its factor, for plain tensors on the CPU.

Says the same as ``factorization.py`` in torch, which tests hold it equal to: half of the pairs of
basis rows, written straight to their places.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import kernel

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]


def factorize_capacitance(
    bases: tuple[Tensor, ...], sizes: list[int], defect: Tensor, seen: Tensor
) -> tuple[Tensor, Tensor]:
    """Lower factors of ``diag(seen) + sum_f b_f b_f' (x) G_f`` and whether there are, (B,)."""
    stacked = torch.cat(bases)
    size = np.repeat(np.array(sizes, np.int64), [len(basis) for basis in bases])
    feature = np.repeat(np.cumsum([0, *sizes[:-1]]), [len(basis) for basis in bases])
    left, right = torch.triu_indices(len(size), len(size))
    pairs = stacked[left] * stacked[right]  # P F
    upper = defect.new_zeros(len(defect), len(seen), len(seen))
    places = left.numpy(), right.numpy(), np.cumsum(size) - size, feature, size
    for b, matrix in enumerate(upper.numpy()):
        summed = (pairs @ defect[b].flatten(1)).reshape(-1, *defect.shape[-2:])
        place_pairs(summed.numpy(), *places, seen.numpy(), matrix)
    # torch keeps to its own number of threads; a BLAS that does not stands still on busy cores
    root, info = torch.linalg.cholesky_ex(upper.mT)
    return root, info == 0


@kernel()
def place_pairs(
    summed: Floats,
    left: Indices,
    right: Indices,
    start: Indices,
    feature: Indices,
    size: Indices,
    seen: Floats,
    matrix: Floats,
) -> None:
    """Blocks (P, E, E) of pairs of basis rows into the upper triangle, and ``seen`` (R,)."""
    for p in range(len(left)):
        t, u = left[p], right[p]
        for i in range(size[t]):
            source = summed[p, feature[t] + i, feature[u] : feature[u] + size[u]]
            target = matrix[start[t] + i, start[u] : start[u] + size[u]]
            for j in range(len(source)):
                target[j] = source[j]
    for r in range(len(seen)):
        matrix[r, r] += seen[r]
