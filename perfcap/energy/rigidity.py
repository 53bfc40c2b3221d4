"""How far the neighbourhoods of graph nodes are from moving rigidly."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import torch
from torch import Tensor

from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.energy import _rigidity_torch
from perfcap.energy._arguments import require_frames, require_unit
from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain
from perfcap.geometry.rotation import skew
from perfcap.solve.coarse_space import CoarseSpace, aggregate
from perfcap.solve.energy import Coupling, Energy, Residual
from perfcap.solve.kernels import Kernel
from perfcap.solve.sparse import BlockLinearization, Curvature


class Rigidity(Energy[Deformation]):
    """As-rigid-as-possible energy of a deformation graph (Xu et al. 2018, Eq. 18).

    A residual group is a directed edge (i, j): where node j is from node i, beside where the
    rotation of i would have it, ``((g_i - g_j) - R_i (c_i - c_j)) / unit`` with canonical positions
    c and ``g_i = c_i + t_i``; 3 entries. The energy of a frame is ``weight`` times the sum over
    neighbours, averaged over nodes. It is zero when all nodes move as one rigid body.

    Args:
        graph: gives the edges.
        nodes: canonical positions c of its nodes, (*b, F, M, 3), metres; see
            ``DeformationGraph.nodes``.
        weight: of the mean.
        kernel: acts on the squared residual, in ``unit``.
        unit: metres that count as one.

    Raises:
        InputError: the nodes are not those of the graph.
    """

    coupling = Coupling.FRAME
    start: Tensor
    end: Tensor
    rest: Tensor
    nodes: Tensor
    group: Tensor

    def __init__(
        self,
        graph: DeformationGraph,
        nodes: Tensor,
        weight: float | Tensor = 1.0,
        kernel: Kernel | None = None,
        unit: float = 1.0,
    ) -> None:
        count = len(graph.node_vertex)
        if nodes.dim() < 3 or nodes.shape[-2:] != (count, 3):
            raise InputError(
                f"nodes have shape {tuple(nodes.shape)} but the graph has {count} nodes; give "
                f"(*b, F, {count}, 3), as DeformationGraph.nodes does"
            )
        super().__init__(weight / count, kernel)
        require_unit(unit)
        start, end = graph.edges.mT.contiguous()
        self.register_buffer("start", start)
        self.register_buffer("end", end)
        self.register_buffer("rest", (nodes[..., start, :] - nodes[..., end, :]) / unit)
        self.register_buffer("nodes", nodes)
        group, self.groups = aggregate(graph.edges.cpu().numpy(), count)
        self.register_buffer("group", torch.from_numpy(group).to(start.device))
        self.scale = 1 / unit

    def residual(self, deformation: Deformation) -> Residual:
        """(*b, F, E, 3)."""
        return self.linearize_blocks(deformation).residual

    def linearize_blocks(self, deformation: Deformation) -> EdgeLinearization:
        """Closed form, kept in fewer numbers than its blocks have."""
        require_frames(self, self.nodes.shape[-3], deformation.translation.shape[-3])
        if deformation.nodes != self.nodes.shape[-2]:
            raise InputError(
                f"Rigidity is made for {self.nodes.shape[-2]} nodes but the deformation has "
                f"{deformation.nodes}; give one of the same graph"
            )
        twin = _twin(self.rest, deformation.rotation, deformation.translation)
        gap, turned = twin.stretch(self.start, self.end, self.rest, self.scale, deformation)
        return EdgeLinearization(Residual(gap), turned, self.start, self.end, self.scale)

    def coarse_space(self, deformation: Deformation) -> CoarseSpace:
        """Rigid motions of groups of nodes, about their middles: only edges between groups resist.

        The modes are a rotation vector and a translation, in the unknowns' units.
        """
        place = self.nodes + deformation.translation  # *b F M 3
        member = self.group == torch.arange(self.groups, device=self.group.device)[:, None]  # C M
        middle = member.to(place) @ place / member.sum(-1, keepdim=True)
        modes = torch.eye(6).to(place).repeat(*place.shape[:-1], 1, 1)
        modes[..., 3:, :3] = skew(middle[..., self.group, :] - place)  # -1, in no group, is any
        return CoarseSpace(self.group, self.groups, modes)


@dataclass(frozen=True)
class EdgeLinearization:
    """Derivative of edges in the nodes at their ends, a ``SparseLinearization``.

    With e the turned edge, ``scale`` s, and twists (w, v) of the two nodes, the residual moves by
    ``s (v_i - v_j) - w_i x e``: a quarter of the blocks' numbers are not zero, and most are s.

    Args:
        residual: (*b, F, E, 3).
        turned: edges as the nodes at their starts rotate them, (*b, F, E, 3), in units.
        start: node i of each edge, (E,).
        end: node j of each edge, (E,).
        scale: derivative in translations, 1 / m.
    """

    residual: Residual
    turned: Tensor
    start: Tensor
    end: Tensor
    scale: float

    def curvature(self, weight: Tensor) -> Curvature:
        """``J' W J`` with the weight (*b, F, E) of each edge."""
        parts = (
            self.turned.flatten(0, -3),
            self.residual.value.flatten(0, -3),
            weight.expand(self.turned.shape[:-1]).flatten(0, -2),
        )
        curvature: Curvature = _twin(*parts).EdgeCurvature(self.start, self.end, self.scale, *parts)
        return curvature

    def as_blocks(self) -> BlockLinearization:
        """The same with the Jacobian written out."""
        ends = torch.stack((self.start, self.end), -1).expand(*self.turned.shape[:-1], 2)
        move = (self.scale * torch.eye(3).to(self.turned)).expand(*self.turned.shape, 3)
        at_start = torch.cat((skew(self.turned), move), -1)
        at_end = torch.cat((torch.zeros_like(move), -move), -1)
        return BlockLinearization(self.residual, ends, torch.stack((at_start, at_end), -3))


def _twin(*tensors: Tensor) -> ModuleType:
    """Compiled loops where only numbers are asked for; torch on GPUs and for derivatives."""
    if is_plain(*tensors):
        from perfcap.energy import _rigidity_numba

        return _rigidity_numba
    return _rigidity_torch
