"""A coarse space for conjugate gradients: groups of blocks that move as one.

What neighbours hold together, single blocks can hardly move, so a preconditioner that sees single
blocks carries a change across the graph by one neighbour a round. A second level that moves whole
groups along the few motions an energy does not resist carries it everywhere at once (Nicolaides
1987, "Deflation of conjugate gradients with applications to boundary value problems").
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import torch
from torch import Tensor

from perfcap.geometry.plain import is_plain
from perfcap.solve.coarse_space import CoarseSpace
from perfcap.solve.sparse_problem import SparseEquations


@dataclass(frozen=True)
class CoarseCorrection:
    """The second level of a preconditioner, ``B (B' H B)^-1 B'`` with the modes B.

    Attributes:
        group: group of each block, -1 for none, (M,).
        modes: (P, M, q, r).
        inverse: of what the groups feel of H, (P, C * r, C * r), zero for problems without.
    """

    group: Tensor
    modes: Tensor
    inverse: Tensor

    def add(self, residual: Tensor, image: Tensor, running: Tensor) -> None:
        """Add the correction of a residual to its image, (P, M, q) both, where running (P,)."""
        own = self.group, self.modes, self.inverse
        _twin(self.modes).correct(*own, residual, image, running)


def coarse_correction(
    space: CoarseSpace, equations: SparseEquations, damping: Tensor
) -> CoarseCorrection:
    """The correction at a state; as a preconditioner it serves states nearby as well.

    Args:
        space: with modes (P, M, q, r).
        equations: H.
        damping: what is added to the diagonal of H, (P, M, q).
    """
    modes, count = space.modes, space.modes.shape[-1]
    matrix = modes.new_zeros(len(modes), space.groups, count, space.groups, count)
    for curvature in equations.curvatures:
        curvature.add_coarse(space, matrix)
    # of the damping, the diagonal is enough: what it is for is that no mode is without any
    own = (damping.unsqueeze(-1) * modes.square()).sum(-2)
    own = torch.where((space.group >= 0)[:, None], own, 0)
    sums = own.new_zeros(len(own), space.groups, count)
    sums.index_add_(1, space.group.clamp(min=0), own)
    size = space.groups * count
    matrix = matrix.view(-1, size, size)
    matrix.diagonal(dim1=-2, dim2=-1).add_(sums.flatten(1))
    return CoarseCorrection(space.group, modes, _inverse(matrix))


def _inverse(matrix: Tensor) -> Tensor:
    """Inverses of symmetric matrices (P, n, n) given by their lower triangles, or zero."""
    size = matrix.diagonal(dim1=-2, dim2=-1)
    scale = torch.where(size > 0, size, 1).rsqrt()  # modes have units of their own
    even = scale.unsqueeze(-1) * matrix * scale.unsqueeze(-2)
    # what rounding may have taken
    even.diagonal(dim1=-2, dim2=-1).add_(matrix.shape[-1] * torch.finfo(matrix.dtype).eps)
    factor, failed = torch.linalg.cholesky_ex(even)
    good = (failed == 0)[:, None, None] & factor.isfinite().all(-1, keepdim=True).all(-2, True)
    eye = torch.eye(matrix.shape[-1]).to(matrix)
    inverse = torch.cholesky_inverse(torch.where(good, factor, eye))
    return torch.where(good, scale.unsqueeze(-1) * inverse * scale.unsqueeze(-2), 0)


def _twin(like: Tensor) -> ModuleType:
    """Compiled loops on the CPU, torch on GPUs."""
    if is_plain(like):
        from perfcap.solve import _coarse_numba

        return _coarse_numba
    from perfcap.solve import _coarse_torch

    return _coarse_torch
