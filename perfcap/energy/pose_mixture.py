"""Poses that people take: a mixture of Gaussians over the joint angles (MuVS Eq. 2)."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.actor.pose_statistics import Mixture
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual


class PoseMixture(Energy[Motion]):
    """Twice the negative log density of the likeliest component (Bogo et al. 2016, Eq. 7).

    ``min_k |L_k' (angles - mean_k)|^2 + c_k``: one group of A + 1 entries a frame, of the
    component that is least; the last entry is the root of c_k >= 0.

    Args:
        mixture: over the angles of the motion, in their order.
        weight: of the energy.
    """

    coupling = Coupling.FRAME
    mean: Tensor
    factor: Tensor
    constant: Tensor

    def __init__(self, mixture: Mixture, weight: float | Tensor = 1.0) -> None:
        super().__init__(weight)
        self.register_buffer("mean", mixture.mean)
        self.register_buffer("factor", mixture.precision)
        self.register_buffer("constant", mixture.surprise.clamp(min=0).sqrt())

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, 1, A + 1)."""
        return self._chosen(motion)[0]

    def linearize(self, motion: Motion) -> Linearization:
        """The transposed factor of the chosen component."""
        residual, index = self._chosen(motion)
        rows = self.factor.to(motion.angles).mT[index]  # *b F A A
        rows = torch.nn.functional.pad(rows, (6, 0, 0, 1))
        return Linearization(residual, rows.unsqueeze(-3))

    def second_order(self, motion: Motion, pull: Tensor) -> None:
        """None: the residual is linear within a component."""

    def _chosen(self, motion: Motion) -> tuple[Residual, Tensor]:
        """Rows, and which component they are of, (*b, F)."""
        angles = motion.angles
        mean, factor, constant = (x.to(angles) for x in (self.mean, self.factor, self.constant))
        white = torch.einsum("kba,...kb->...ka", factor, angles.unsqueeze(-2) - mean)
        index = (white.square().sum(-1) + constant.square()).argmin(-1)
        picked = index[..., None, None].expand(*index.shape, 1, white.shape[-1])
        row = torch.cat((white.gather(-2, picked), constant[index][..., None, None]), -1)
        return Residual(row), index
