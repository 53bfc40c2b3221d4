"""Products of very many very small matrices, which general batched products are slow at."""

from __future__ import annotations

from torch import Size, Tensor

from perfcap.geometry.plain import is_plain


def multiply_views(left: Tensor, right: Tensor) -> Tensor:
    """Matrices (*b, C, N, d, 3) of C views times matrices (*b, N, 3, D) shared by the views.

    Returns:
        (*b, C, N, d, D): a chain rule through C cameras.
    """
    if is_plain(left, right) and _fit(left.shape, right.shape):
        from perfcap.geometry import _product_numba

        return _product_numba.multiply_views(left, right)
    return left @ right.unsqueeze(-4)


def _fit(left: Size, right: Size) -> bool:
    """Whether compiled loops may take them; torch broadcasts others, or says what is wrong."""
    whole = len(left) >= 4 and len(right) >= 3 and 0 not in left and 0 not in right
    return whole and (*left[:-4], left[-3]) == right[:-2] and left[-1] == right[-2] == 3
