"""Factors of the block of every frame, before anything couples the frames."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.geometry.plain import is_plain


def factorize_frames(
    curvature: Tensor, damping: Tensor, jacobian: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Factorize ``M = A + J'J`` and what the coupling of frames needs of it.

    Args:
        curvature: curvature of the data, (B, F, D, D).
        damping: what to add to its diagonal for A, (B, F, D).
        jacobian: J, the features of window energies, (B, F, E, D); E may be 0.

    Returns:
        cholesky: lower factors of M, (B, F, D, D).
        solved: Y = M^-1 J', (B, F, D, E).
        defect: G = I - J Y, (B, F, E, E), as ``(I - J Y)^2 + Y' A Y``: accurate where it is small.
        valid: whether M is positive definite, (B, F); if not, the rest is finite and means nothing.
    """
    if is_plain(curvature, damping, jacobian):
        from perfcap.solve import _frames_numba

        return _frames_numba.factorize_frames(curvature, damping, jacobian)
    features, dim = jacobian.shape[-2:]
    stacked = torch.cat((jacobian, curvature), -2)
    stacked[..., features:, :].diagonal(dim1=-2, dim2=-1).add_(damping)
    cholesky, info = torch.linalg.cholesky_ex(stacked[..., features:, :] + jacobian.mT @ jacobian)
    valid = (info == 0) & cholesky.diagonal(dim1=-2, dim2=-1).isfinite().all(-1)
    identity = torch.eye(dim, dtype=cholesky.dtype, device=cholesky.device)
    cholesky = torch.where(valid[..., None, None], cholesky, identity)
    stacked = torch.where(valid[..., None, None], stacked, 0)
    solved = torch.cholesky_solve(jacobian.mT, cholesky)
    # one product for J Y and A Y, one for the two of G: fewer, larger products run faster
    product = stacked @ solved
    product[..., :features, :].neg_().diagonal(dim1=-2, dim2=-1).add_(1)
    left = torch.cat((product[..., :features, :], solved), -2)
    return cholesky, solved, left.mT @ product, valid


def solve_frames(cholesky: Tensor, right: Tensor) -> Tensor:
    """``M^-1`` times vectors (B, F, D), of lower factors (B, F, D, D)."""
    if is_plain(cholesky, right):
        from perfcap.solve import _frames_numba

        return _frames_numba.solve_frames(cholesky, right)
    return torch.cholesky_solve(right.unsqueeze(-1), cholesky).squeeze(-1)
