"""The deformation graph: a few nodes whose warps carry the whole surface along."""

from __future__ import annotations

from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from perfcap.actor.deformation import Deformation
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import linear_blend
from perfcap.array_checks import require_indices, require_shape
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix

NODES = 1000  # Xu 2018, Sec. 5.3
_ROUNDING = 1e-3  # of shares that sum to one
INFLUENCES = 6  # nodes that move a vertex; measured, see ``DeformationGraph.build``


class DeformationGraph(nn.Module):
    """Embedded deformation of a posed surface (Sumner et al. 2007; Xu et al. 2018, Eq. 13-15).

    Node k sits on a template vertex, at ``g_k`` in a posed surface, and warps the space around it
    by ``W_k(x) = R_k (x - g_k) + g_k + t_k``. A vertex moves with the blend of its nodes' warps,
    ``sum_k b_k W_k(v)``, whose shares b are a constant of the template (MPC-28).

    Args:
        node_vertex: template vertex each node sits on, (M,).
        edges: directed pairs (i, j) of neighbours, both directions of each, sorted, (E, 2).
        influences: nodes that move each vertex, heaviest first, (V, K); a node may be repeated
            with share 0 where there are fewer.
        influence_weights: their shares, rows summing to one, (V, K).
        radius: largest distance of a node to its neighbours along the surface, (M,) metres.

    Raises:
        InputError: shapes or numbers of nodes and vertices that do not fit each other.
    """

    node_vertex: Tensor
    edges: Tensor
    influences: Tensor
    influence_weights: Tensor
    radius: Tensor

    def __init__(
        self,
        node_vertex: Tensor,
        edges: Tensor,
        influences: Tensor,
        influence_weights: Tensor,
        radius: Tensor,
    ) -> None:
        super().__init__()
        nodes, vertices = len(node_vertex), len(influences)
        require_shape(node_vertex, "node_vertex", (nodes,), "(M,), the vertex of each node")
        require_shape(influences, "influences", (vertices, None), "(V, K), of each vertex")
        require_shape(edges, "edges", (None, 2), "(E, 2), pairs of nodes")
        require_shape(radius, "radius", (nodes,), "(M,), of each node")
        require_indices(node_vertex, "node_vertex", vertices, "vertices")
        require_indices(influences, "influences", nodes, "nodes")
        require_indices(edges, "edges", nodes, "nodes")
        off = (influence_weights.sum(-1) - 1).abs()
        if not bool((off < _ROUNDING).all()):
            raise InputError(
                f"influence_weights have rows that sum to one but for {float(off.max()):.3g}; "
                "divide each by its sum"
            )
        # a function of the template, which is what is stored
        self.register_buffer("node_vertex", node_vertex, persistent=False)
        self.register_buffer("edges", edges, persistent=False)
        self.register_buffer("influences", influences, persistent=False)
        self.register_buffer("influence_weights", influence_weights, persistent=False)
        self.register_buffer("radius", radius, persistent=False)
        self.blend = SkinWeights(influence_weights, influences)

    @classmethod
    def build(
        cls,
        vertices: Tensor | NDArray[np.floating],
        faces: Tensor | NDArray[np.integer],
        nodes: int = NODES,
        influences: int = INFLUENCES,
    ) -> Self:
        """Graph of a template in its rest pose (MPC-26 to MPC-28); the same for the same template.

        Nodes are spread by farthest-point sampling along the surface, which decimates uniformly
        whatever the density of vertices. Two are neighbours when the cells of what is nearest to
        them share an edge of the mesh. Shares fall off as ``exp(-3 (d / radius)^2)`` with the
        distance d along the surface, so an arm beside the body is not coupled to it. Vertices at
        one place have the same shares: texture seams stay closed.

        Every part that is not connected to the rest gets a node, and edges that tie it to larger
        parts where it touches them; see ``graph_bridges``. Where parts are more than half of the
        nodes, the smallest get none; they, and vertices of no triangle, move as the nearest
        vertex that has nodes.

        Args:
            vertices: rest pose, (V, 3), metres; the graph takes the type and device of a tensor.
            faces: triangles, (T, 3).
            nodes: M at most; fewer where the template has fewer vertices.
            influences: K. On a skirt deformed by smooth waves of 2 cm, and with 5 mm of noise
                on its nodes, the angles between neighbouring triangles are off by 3.7 and 5.5
                degrees (rms) with 4, 2.5 and 3.4 with 6, 2.1 and 2.7 with 8.

        Raises:
            InputError: the mesh is none, or has no triangle.
        """
        from perfcap.actor.graph_sampling import lay_out

        like = vertices if isinstance(vertices, Tensor) else torch.tensor(np.asarray(vertices))
        corners = faces.detach().cpu().numpy() if isinstance(faces, Tensor) else np.asarray(faces)
        layout = lay_out(like.detach().cpu().double().numpy(), corners, nodes, influences)
        return cls(
            torch.from_numpy(layout.node_vertex).to(like.device),
            torch.from_numpy(layout.edges).to(like.device),
            torch.from_numpy(layout.influences).to(like.device),
            torch.from_numpy(layout.influence_weights).to(like),
            torch.from_numpy(layout.radius).to(like),
        )

    def __len__(self) -> int:
        """M."""
        return len(self.node_vertex)

    def nodes(self, posed: Tensor) -> Tensor:
        """Canonical node positions (*b, F, M, 3) of posed vertices (*b, F, V, 3), metres."""
        return posed[..., self.node_vertex, :]

    def identity(self, posed: Tensor) -> Deformation:
        """No deformation of posed vertices (*b, F, V, 3)."""
        return Deformation.identity(posed.shape[:-2], len(self), posed)

    def forward(self, posed: Tensor, deformation: Deformation) -> Tensor:
        """Deformed vertices (Xu 2018, Eq. 15).

        Args:
            posed: canonical vertices, skinned to each frame, (*b, F, V, 3), metres.
            deformation: (*b, F, M).

        Returns:
            (*b, F, V, 3), metres; where no node turns or moves, ``posed`` to the last bit.
        """
        self._check(posed, deformation)
        # blended displacements: small numbers, and none at all without deformation
        turn = rotvec_to_matrix(deformation.rotation) - torch.eye(3).to(posed)
        lever = (turn @ self.nodes(posed).unsqueeze(-1)).squeeze(-1)
        return posed + linear_blend(posed, self.blend, turn, deformation.translation - lever)

    def _check(self, posed: Tensor, deformation: Deformation) -> None:
        expected = (*posed.shape[:-2], len(self), 3)
        if posed.shape[-2:] != (len(self.influences), 3) or deformation.rotation.shape != expected:
            raise InputError(
                f"posed has shape {tuple(posed.shape)} and deformation "
                f"{tuple(deformation.rotation.shape)}; give (*b, F, {len(self.influences)}, 3) "
                f"and (*b, F, {len(self)}, 3)"
            )
