"""Products of many small matrices, for plain tensors on the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import kernel

Floats = NDArray[np.floating[Any]]


def multiply_views(left: Tensor, right: Tensor) -> Tensor:
    """Left (*b, C, N, d, 3) times right (*b, N, 3, D); see ``product.multiply_views``."""
    *lead, views, count, rows, _ = left.shape
    product = left.new_empty(*lead, views, count, rows, right.shape[-1])
    _multiply(
        np.ascontiguousarray(left.detach().numpy()).reshape(-1, views, count, rows, 3),
        np.ascontiguousarray(right.detach().numpy()).reshape(-1, count, 3, right.shape[-1]),
        product.numpy().reshape(-1, views, count, rows, right.shape[-1]),
    )
    return product


@kernel()
def _multiply(left: Floats, right: Floats, product: Floats) -> None:
    """The innermost loop runs along rows of contiguous memory, which vectorises."""
    frames, views, count, rows, columns = product.shape
    for frame in range(frames):
        for view in range(views):
            for n in range(count):
                for i in range(rows):
                    a = left[frame, view, n, i, 0]
                    b = left[frame, view, n, i, 1]
                    c = left[frame, view, n, i, 2]
                    for k in range(columns):
                        x, y, z = (
                            right[frame, n, 0, k],
                            right[frame, n, 1, k],
                            right[frame, n, 2, k],
                        )
                        product[frame, view, n, i, k] = a * x + b * y + c * z
