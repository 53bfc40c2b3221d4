"""Normal equations of residual rows as compiled loops, for plain tensors on the CPU.

Says the same as ``rows.add_rows`` in torch, which tests hold it equal to.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import kernel
from perfcap.solve._products_numba import add_gram

Floats = NDArray[np.floating[Any]]


def add_rows(
    jacobian: Tensor, residual: Tensor, weight: Tensor, curvature: Tensor, gradient: Tensor
) -> None:
    """See ``rows.add_rows``."""
    *_, groups, entries, dim = jacobian.shape
    frames = gradient.shape[:-1].numel()
    constant = jacobian.stride()[:2] == (0, 0)  # one frame stands for all
    rows = jacobian[:1, :1] if constant else jacobian
    _add_rows(
        _contiguous(rows, rows.shape[:2].numel(), groups * entries, dim),
        _contiguous(residual, frames, groups * entries),
        _contiguous(weight, frames, groups),
        curvature.numpy().reshape(frames, dim, dim),
        gradient.numpy().reshape(frames, dim),
    )


def _contiguous(tensor: Tensor, *shape: int) -> Floats:
    """As another memory layout would compile the kernel once more."""
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(shape)


@kernel(fastmath={"contract"})
def _add_rows(
    jacobian: Floats, residual: Floats, weight: Floats, curvature: Floats, gradient: Floats
) -> None:
    """All frames, one after the other; ``jacobian`` has rows of each, or of one for all."""
    count, dim = jacobian.shape[1:]
    entries = count // max(1, weight.shape[1])
    weighted = np.empty((count, dim), jacobian.dtype)
    for n in range(len(gradient)):
        rows = jacobian[n % len(jacobian)]
        for r in range(count):
            share, value = weight[n, r // entries], residual[n, r]
            for j in range(dim):
                pull = share * rows[r, j]
                weighted[r, j] = pull
                gradient[n, j] += value * pull
        add_gram(curvature[n], rows, weighted)
