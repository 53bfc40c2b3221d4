"""Graph nodes stay near where the skeleton puts them."""

from __future__ import annotations

import torch

from perfcap.actor.deformation import BLOCK, Deformation
from perfcap.energy._arguments import require_unit
from perfcap.errors import InputError
from perfcap.setting_checks import require_count
from perfcap.solve.energy import Coupling, Energy, Residual
from perfcap.solve.kernels import Kernel
from perfcap.solve.sparse import BlockLinearization


class Tether(Energy[Deformation]):
    """Mean squared displacement of graph nodes; not in the paper.

    A rigid motion of the whole surface costs ``Rigidity`` nothing, and one towards the camera
    hardly moves a contour: without a tether the surface wanders in depth from frame to frame.
    A residual group is one node: translation / unit, 3 entries. The energy of a frame is
    ``weight`` times the mean over nodes.

    Args:
        nodes: M.
        weight: of the mean.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one.
    """

    coupling = Coupling.FRAME

    def __init__(
        self, nodes: int, weight: float = 1.0, kernel: Kernel | None = None, unit: float = 1.0
    ) -> None:
        require_count(nodes, "nodes")
        super().__init__(weight / nodes, kernel)
        self.nodes = nodes
        require_unit(unit)
        self.scale = 1 / unit

    def residual(self, deformation: Deformation) -> Residual:
        """(*b, F, M, 3)."""
        own = deformation.translation.shape[-2]
        if own != self.nodes:
            raise InputError(
                f"Tether is made for {self.nodes} nodes but the deformation has {own}; make one "
                "for as many: len(graph)"
            )
        return Residual(self.scale * deformation.translation)

    def linearize_blocks(self, deformation: Deformation) -> BlockLinearization:
        """Closed form: each node sees its own translation."""
        residual = self.residual(deformation)
        lead = residual.value.shape[:-1]  # *b F M
        jacobian = residual.value.new_zeros(3, BLOCK)
        jacobian[:, 3:] = self.scale * torch.eye(3).to(jacobian)
        blocks = torch.arange(lead[-1], device=jacobian.device).unsqueeze(-1)
        return BlockLinearization(
            residual, blocks.expand(*lead, 1), jacobian.expand(*lead, 1, 3, BLOCK).contiguous()
        )
