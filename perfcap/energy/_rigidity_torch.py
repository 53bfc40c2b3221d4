"""Edges of a deformation graph in torch: for GPUs and derivatives, and what the kernels must equal.

See ``rigidity.py`` for the notation: an edge (i, j), turned by its start, is e; s is ``scale``.
"""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.deformation import Deformation
from perfcap.geometry.rotation import rotvec_to_matrix, skew
from perfcap.solve._coarse_torch import add_outer
from perfcap.solve.coarse_space import CoarseSpace


def stretch(
    start: Tensor, end: Tensor, rest: Tensor, scale: float, deformation: Deformation
) -> tuple[Tensor, Tensor]:
    """Residual of each edge and the turned edge, (*b, F, E, 3) both, in units."""
    rotation = rotvec_to_matrix(deformation.rotation)[..., start, :, :]
    turned = (rotation @ rest.unsqueeze(-1)).squeeze(-1)
    shift = deformation.translation[..., start, :] - deformation.translation[..., end, :]
    return scale * shift + (rest - turned), turned


class EdgeCurvature:
    """``J' W J`` of edges, see ``solve.sparse.Curvature``; tensors are (P, E, 3) and (P, E)."""

    def __init__(
        self,
        start: Tensor,
        end: Tensor,
        scale: float,
        turned: Tensor,
        residual: Tensor,
        weight: Tensor,
    ) -> None:
        self.start, self.end, self.scale = start, end, scale
        self.turned, self.residual, self.weight = turned, residual, weight

    def add_equations(self, gradient: Tensor, diagonal: Tensor) -> None:
        """See ``Curvature``; with e the turned edge, |e|^2 I - e e', s [e] below, and s^2 I."""
        self._pull(gradient, self.residual)
        e, weight = self.turned, self.weight[..., None, None]
        eye = torch.eye(3).to(e)
        turn = e.square().sum(-1)[..., None, None] * eye - e.unsqueeze(-1) * e.unsqueeze(-2)
        cross = skew(e)
        move = (weight * self.scale**2 * eye).expand_as(turn)
        diagonal[..., :3, :3].index_add_(1, self.start, weight * turn.tril())
        diagonal[..., 3:, :3].index_add_(1, self.start, self.scale * weight * cross)
        diagonal[..., 3:, 3:].index_add_(1, self.start, move)
        diagonal[..., 3:, 3:].index_add_(1, self.end, move)

    def add_product(self, direction: Tensor, product: Tensor, running: Tensor) -> None:
        """See ``Curvature``."""
        turn, shift = direction[..., :3], direction[..., 3:]
        move = self.scale * (shift[:, self.start] - shift[:, self.end])
        self._pull(product, move - torch.linalg.cross(turn[:, self.start], self.turned))

    def add_coarse(self, space: CoarseSpace, matrix: Tensor) -> None:
        """See ``Curvature``; edges within a group, which move with it, are left out."""
        turn, shift = space.modes[..., :3, :], space.modes[..., 3:, :]  # P M 3 r
        edge = self.turned.unsqueeze(-1)
        at_start = self.scale * shift[:, self.start] - torch.linalg.cross(
            turn[:, self.start], edge, dim=-2
        )
        rows = torch.stack((at_start, -self.scale * shift[:, self.end]), 2)  # P E 2 3 r
        groups = space.group[torch.stack((self.start, self.end), -1)]
        groups = torch.where(groups[:, :1] == groups[:, 1:], -1, groups)
        add_outer(matrix, groups.expand(len(matrix), -1, -1), rows, self.weight)

    def _pull(self, out: Tensor, change: Tensor) -> None:
        """Add ``J' W change``."""
        pull = self.weight[..., None] * change
        out[..., :3].index_add_(1, self.start, torch.linalg.cross(pull, self.turned))
        out[..., 3:].index_add_(1, self.start, self.scale * pull)
        out[..., 3:].index_add_(1, self.end, -self.scale * pull)
