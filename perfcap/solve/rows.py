"""Residual rows added to the blocks of normal equations."""

from __future__ import annotations

from torch import Tensor

from perfcap.geometry.plain import is_plain
from perfcap.solve.products import apply_transposed


def add_rows(
    jacobian: Tensor, residual: Tensor, weight: Tensor, curvature: Tensor, gradient: Tensor
) -> None:
    """Add ``J' W J`` and ``J' W r`` of every frame, in place.

    Args:
        jacobian: J, (B, F, G, d, D).
        residual: r, (B, F, G, d).
        weight: diagonal of W, the same for the d entries of a group, (B, F, G).
        curvature: what to add to, (B, F, D, D), contiguous.
        gradient: the same, (B, F, D).
    """
    if is_plain(jacobian, residual, weight, curvature, gradient):
        from perfcap.solve import _rows_numba

        return _rows_numba.add_rows(jacobian, residual, weight, curvature, gradient)
    rows, weights = jacobian.flatten(2, 3), weight.unsqueeze(-1).expand_as(residual).flatten(2)
    curvature += (weights.unsqueeze(-1) * rows).mT @ rows
    gradient += apply_transposed(rows, weights * residual.flatten(2))
    return None
