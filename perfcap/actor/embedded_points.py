"""Chosen points of a surface as a function of its deformation, without deforming the rest of it."""

from __future__ import annotations

from types import ModuleType

import torch
from torch import Tensor, nn

from perfcap.actor import _embedded_points_torch
from perfcap.actor._embedded_points_torch import Embedding
from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.actor.points import require_directions
from perfcap.errors import InputError
from perfcap.geometry.plain import is_plain


class EmbeddedPoints(nn.Module):
    """Points ``sum_s weight_s * vertex_s`` of a surface that a graph deforms (Xu 2018, Eq. 15).

    Equal to the same sums over ``DeformationGraph.forward``, at the cost of the nodes that the
    points see. A point x sees each of its nodes k once: with the nodes' shares b of its corners
    v_s, and g_k the canonical positions,

        x(R, t) = x + sum_k (R_k - I) a_k + s_k t_k,
        a_k = sum_s weight_s b_sk (v_s - g_k),   s_k = sum_s weight_s b_sk.

    Args:
        graph: what deforms the surface.
        posed: canonical vertices, skinned to each frame, (*b, F, V, 3), metres.
        corners: vertices of each point, (*b, F, N, S) integer; leading axes may be left out where
            the points are the same, down to (N, S).
        weights: of the corners, the shape of ``corners``. Points whose weights are all zero, as
            those that pad a list, lie at the origin and see no node.

    Raises:
        InputError: shapes or vertex numbers do not fit.
    """

    base: Tensor
    blocks: Tensor
    arm: Tensor
    share: Tensor

    def __init__(
        self, graph: DeformationGraph, posed: Tensor, corners: Tensor, weights: Tensor
    ) -> None:
        super().__init__()
        _check(graph, posed, corners, weights)
        self.nodes = len(graph)
        shape = (*posed.shape[:-2], *corners.shape[-2:])
        chosen = corners.expand(shape), weights.to(posed).expand(shape)
        shares = graph.influence_weights.to(posed)
        embedding = _twin(posed, chosen[1], shares).merge(graph, shares, posed, *chosen)
        self.register_buffer("base", embedding.base)
        self.register_buffer("blocks", embedding.blocks)
        self.register_buffer("arm", embedding.arm)
        self.register_buffer("share", embedding.share)

    def forward(self, deformation: Deformation) -> Tensor:
        """Points in the world, (*b, F, N, 3), metres."""
        self._require_fitting(deformation)
        points: Tensor = self._twin_for(deformation).place(self._embedding(), deformation)
        return points

    def linearize_blocks(
        self, deformation: Deformation, directions: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Points and their derivative in closed form.

        Args:
            deformation: where.
            directions: (*b, F, N, Q, 3), to get the derivative of ``directions . point`` only;
                saves time and memory over the derivative of all three coordinates.

        Returns:
            points: in the world, (*b, F, N, 3), metres.
            blocks: nodes that a point sees, (*b, F, N, k), -1 for none.
            derivative: of the point in each node's rotation and translation, zero where there is
                none, (*b, F, N, k, 3, 6), or (*b, F, N, k, Q, 6) along directions.
        """
        self._require_fitting(deformation)
        if directions is None:
            directions = torch.eye(3).to(self.base).expand(*self.base.shape, 3)
        require_directions(directions, self.base.shape[:-1])
        points, derivative = self._twin_for(deformation, directions).linearize(
            self._embedding(), deformation, directions
        )
        return points, self.blocks, derivative

    def _require_fitting(self, deformation: Deformation) -> None:
        """Compiled loops believe the shapes they are given."""
        own, wanted = tuple(deformation.translation.shape), (*self.base.shape[:-2], self.nodes, 3)
        if own != wanted:
            raise InputError(
                f"deformation has shape {own}, expected {wanted}: of the frames that the points "
                "were posed in, and the nodes of their graph"
            )

    def _embedding(self) -> Embedding:
        return Embedding(self.base, self.blocks, self.arm, self.share)

    def _twin_for(self, deformation: Deformation, *more: Tensor) -> ModuleType:
        return _twin(self.arm, self.base, deformation.rotation, deformation.translation, *more)


def _twin(*tensors: Tensor) -> ModuleType:
    """Compiled loops where only numbers are asked for; torch on GPUs and for derivatives."""
    if is_plain(*tensors):
        from perfcap.actor import _embedded_points_numba

        return _embedded_points_numba
    return _embedded_points_torch


def _check(graph: DeformationGraph, posed: Tensor, corners: Tensor, weights: Tensor) -> None:
    vertices = len(graph.influences)
    if posed.dim() < 3 or posed.shape[-2:] != (vertices, 3):
        raise InputError(
            f"posed has shape {tuple(posed.shape)} but the graph deforms {vertices} vertices; "
            f"give (*b, F, {vertices}, 3)"
        )
    if corners.dim() < 2 or corners.is_floating_point() or corners.shape != weights.shape:
        raise InputError(
            f"points have corners {tuple(corners.shape)} of {corners.dtype} and weights "
            f"{tuple(weights.shape)}; give vertex indices and weights of one shape (*b, F, N, S)"
        )
    lead, frames = corners.shape[:-2], posed.shape[:-2]
    if lead != frames[len(frames) - len(lead) :]:
        raise InputError(
            f"points have corners {tuple(corners.shape)} but posed has frames {tuple(frames)}; "
            f"give corners {(*frames, *corners.shape[-2:])}"
        )
    if corners.numel() and (corners.min() < 0 or corners.max() >= vertices):
        raise InputError(
            f"points have corners from {int(corners.min())} to {int(corners.max())} but the "
            f"surface has {vertices} vertices; give indices of its vertices"
        )
