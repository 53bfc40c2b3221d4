"""Products of very many very small matrices, which general batched products are slow at."""

from __future__ import annotations

from torch import Tensor

from perfcap.geometry.plain import is_plain


def multiply_views(left: Tensor, right: Tensor) -> Tensor:
    """Matrices (*b, C, N, d, 3) of C views times matrices (*b, N, 3, D) shared by the views.

    Returns:
        (*b, C, N, d, D): a chain rule through C cameras.
    """
    if is_plain(left, right) and left.shape[:-4] == right.shape[:-3]:
        from perfcap.geometry import _product_numba

        return _product_numba.multiply_views(left, right)
    return left @ right.unsqueeze(-4)
