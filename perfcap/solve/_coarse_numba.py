"""Coarse corrections as compiled loops, for the CPU.

Says the same as ``_coarse_torch.py``, which tests hold it equal to. Lengths of tuples are known
when the kernels are compiled, so the innermost loops are unrolled; their entries mean nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


def correct(
    group: Tensor, modes: Tensor, inverse: Tensor, residual: Tensor, image: Tensor, running: Tensor
) -> None:
    """See ``coarse.CoarseCorrection.add``."""
    arrays = (t.numpy() for t in (group, modes, inverse, residual, image, running))
    _correct(*arrays, *((0,) * count for count in modes.shape[-2:]))


@kernel()
def _correct(
    group: Indices,
    modes: Floats,
    inverse: Floats,
    residual: Floats,
    image: Floats,
    running: Flags,
    unknowns: tuple[int, ...],
    counts: tuple[int, ...],
) -> None:
    size = inverse.shape[1]
    pull, moved = np.empty(size, residual.dtype), np.empty(size, residual.dtype)
    for p in range(len(residual)):
        if not running[p]:
            continue
        pull[:] = 0
        moved[:] = 0
        for i in range(len(group)):
            if group[i] >= 0:
                first = group[i] * len(counts)
                for c in range(len(unknowns)):
                    for m in range(len(counts)):
                        pull[first + m] += modes[p, i, c, m] * residual[p, i, c]
        for n in range(size):  # by columns, which vectorises
            for m in range(size):
                moved[m] += inverse[p, n, m] * pull[n]
        _prolong(group, modes[p], moved, image[p], unknowns, counts)


@inner()
def _prolong(
    group: Indices,
    modes: Floats,
    moved: Floats,
    image: Floats,
    unknowns: tuple[int, ...],
    counts: tuple[int, ...],
) -> None:
    """Add to the blocks what their groups move."""
    for i in range(len(group)):
        if group[i] >= 0:
            first = group[i] * len(counts)
            for c in range(len(unknowns)):
                for m in range(len(counts)):
                    image[i, c] += modes[i, c, m] * moved[first + m]


@inner()
def find_slot(groups: Indices, used: int, group: int) -> int:
    """Where a group is among the first ``used``, or ``used`` if it is not."""
    for slot in range(used):
        if groups[slot] == group:
            return slot
    return used


@inner()
def add_outer(
    matrix: Floats,
    groups: Indices,
    used: int,
    rows: Floats,
    weight: float,
    counts: tuple[int, ...],
) -> None:
    """Add what one group of residuals has, see ``_coarse_torch.add_outer``.

    ``matrix`` is (C, r, C, r); of ``groups`` (k,), all different, and ``rows`` (k, d, r) the first
    ``used`` count.
    """
    for a in range(used):
        for b in range(used):
            i, j = groups[a], groups[b]
            for d in range(rows.shape[1] if i >= j else 0):
                for m in range(len(counts)):
                    scaled = weight * rows[a, d, m]
                    for n in range(len(counts)):
                        matrix[i, m, j, n] += scaled * rows[b, d, n]
