"""Chosen points of a surface as a function of its deformation, without deforming the rest of it."""

from __future__ import annotations

from types import ModuleType

import torch
from torch import Tensor, nn

from perfcap.actor import _embedded_points_torch
from perfcap.actor._embedded_points_torch import Embedding
from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
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
        shape = (*posed.shape[:-2], *corners.shape[-2:])
        embedding = _merge(graph, posed, corners.expand(shape), weights.to(posed).expand(shape))
        self.register_buffer("base", embedding.base)
        self.register_buffer("blocks", embedding.blocks)
        self.register_buffer("arm", embedding.arm)
        self.register_buffer("share", embedding.share)

    def forward(self, deformation: Deformation) -> Tensor:
        """Points in the world, (*b, F, N, 3), metres."""
        points: Tensor = self._twin(deformation).place(self._embedding(), deformation)
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
        if directions is None:
            directions = torch.eye(3).to(self.base).expand(*self.base.shape, 3)
        points, derivative = self._twin(deformation, directions).linearize(
            self._embedding(), deformation, directions
        )
        return points, self.blocks, derivative

    def _embedding(self) -> Embedding:
        return Embedding(self.base, self.blocks, self.arm, self.share)

    def _twin(self, deformation: Deformation, *more: Tensor) -> ModuleType:
        """Compiled loops where only numbers are asked for; torch on GPUs and for derivatives."""
        unknowns = deformation.rotation, deformation.translation
        if is_plain(self.arm, self.base, *unknowns, *more):
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


def _merge(graph: DeformationGraph, posed: Tensor, corners: Tensor, weights: Tensor) -> Embedding:
    """What points see of each node, every node once."""
    vertices = _pick(posed, corners)  # *b F N S 3
    base = (weights.unsqueeze(-1) * vertices).sum(-2)
    nodes = graph.influences[corners]  # *b F N S K
    share = weights.unsqueeze(-1) * graph.influence_weights[corners]
    lever = vertices.unsqueeze(-2) - _pick(graph.nodes(posed), nodes)
    arm = (share.unsqueeze(-1) * lever).flatten(-3, -2)
    seen, order = torch.where(share != 0, nodes, len(graph)).flatten(-2).sort(dim=-1)
    parts = torch.cat((arm, share.flatten(-2).unsqueeze(-1)), -1)
    parts = parts.gather(-2, order.unsqueeze(-1).expand_as(parts))
    # runs of one node become a slot each; what is not used is the last run
    fresh = torch.ones_like(seen)
    fresh[..., 1:] = seen[..., 1:] != seen[..., :-1]
    slot = fresh.cumsum(-1) - 1
    slots = int(torch.where(seen < len(graph), slot + 1, 0).max()) if seen.numel() else 0
    sums = torch.zeros_like(parts).scatter_add(-2, slot.unsqueeze(-1).expand_as(parts), parts)
    blocks = torch.full_like(seen, -1).scatter(-1, slot, seen.where(seen < len(graph), -1))
    sums, blocks = sums[..., :slots, :], blocks[..., :slots]
    return Embedding(base, blocks.contiguous(), sums[..., :3].contiguous(), sums[..., 3])


def _pick(values: Tensor, index: Tensor) -> Tensor:
    """Rows (*b, F, N, ..., 3) of values (*b, F, V, 3) at an index (*b, F, N, ...)."""
    flat = index.flatten(values.dim() - 2)
    rows = values.gather(-2, flat.unsqueeze(-1).expand(*flat.shape, 3))
    return rows.reshape(*index.shape, 3)
