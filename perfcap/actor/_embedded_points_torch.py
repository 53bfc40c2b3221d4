"""Chosen points of a deformed surface in plain torch; the oracle of the compiled twin."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.geometry.rotation import rotvec_to_matrix


class Embedding(NamedTuple):
    """Points without deformation, and their leverage on nodes; see ``EmbeddedPoints``."""

    base: Tensor  # (*b, F, N, 3) m
    blocks: Tensor  # (*b, F, N, k) nodes, -1 for none
    arm: Tensor  # (*b, F, N, k, 3) m, zero where there is no node
    share: Tensor  # (*b, F, N, k), zero where there is no node


def merge(
    graph: DeformationGraph, shares: Tensor, posed: Tensor, corners: Tensor, weights: Tensor
) -> Embedding:
    """What points see of each node, every node once, in order.

    Args:
        graph: whose nodes.
        shares: of the nodes in vertices, (V, K).
        posed: canonical vertices, (*b, F, V, 3), metres.
        corners: (*b, F, N, S).
        weights: of the corners, (*b, F, N, S).
    """
    vertices = _pick(posed, corners)  # *b F N S 3
    nodes = graph.influences[corners]  # *b F N S K
    share = weights.unsqueeze(-1) * shares[corners]
    lever = vertices.unsqueeze(-2) - _pick(graph.nodes(posed), nodes)
    arm = share.unsqueeze(-1) * lever
    seen, order = torch.where(share != 0, nodes, len(graph)).flatten(-2).sort(dim=-1)
    parts = torch.cat((arm, share.unsqueeze(-1)), -1).flatten(-3, -2)
    parts = parts.gather(-2, order.unsqueeze(-1).expand_as(parts))
    # runs of one node become a slot each; what is not used is the last run
    fresh = torch.ones_like(seen)
    fresh[..., 1:] = seen[..., 1:] != seen[..., :-1]
    slot = fresh.cumsum(-1) - 1
    slots = int(torch.where(seen < len(graph), slot + 1, 0).max()) if seen.numel() else 0
    sums = torch.zeros_like(parts).scatter_add(-2, slot.unsqueeze(-1).expand_as(parts), parts)
    blocks = torch.full_like(seen, -1).scatter(-1, slot, seen.where(seen < len(graph), -1))
    base = (weights.unsqueeze(-1) * vertices).sum(-2)
    sums, blocks = sums[..., :slots, :], blocks[..., :slots]
    return Embedding(base, blocks, sums[..., :3], sums[..., 3])


def _pick(values: Tensor, index: Tensor) -> Tensor:
    """Rows (*b, F, N, ..., 3) of values (*b, F, V, 3) at an index (*b, F, N, ...)."""
    flat = index.flatten(values.dim() - 2)
    rows = values.gather(-2, flat.unsqueeze(-1).expand(*flat.shape, 3))
    return rows.reshape(*index.shape, 3)


def place(embedding: Embedding, deformation: Deformation) -> Tensor:
    """Points (*b, F, N, 3)."""
    return _place(embedding, deformation)[0]


def linearize(
    embedding: Embedding, deformation: Deformation, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Points, and their derivative along directions (*b, F, N, Q, 3), (*b, F, N, k, Q, 6)."""
    points, turned = _place(embedding, deformation)
    along = directions.unsqueeze(-3).expand(*turned.shape[:-1], *directions.shape[-2:])
    # along . (w x arm) = (arm x along) . w
    turn = torch.linalg.cross(turned.unsqueeze(-2).expand_as(along), along)
    return points, torch.cat((turn, embedding.share[..., None, None] * along), -1)


def _place(embedding: Embedding, deformation: Deformation) -> tuple[Tensor, Tensor]:
    """Points, and the arms that their nodes have turned, (*b, F, N, k, 3)."""
    shape = embedding.blocks.shape
    nodes = embedding.blocks.clamp(min=0).flatten(-2)[..., None, None]
    turn = rotvec_to_matrix(deformation.rotation)
    turn = turn.gather(-3, nodes.expand(*nodes.shape[:-2], 3, 3)).reshape(*shape, 3, 3)
    shift = deformation.translation.gather(-2, nodes[..., 0].expand(*nodes.shape[:-2], 3))
    turned = (turn @ embedding.arm.unsqueeze(-1)).squeeze(-1)
    moved = turned - embedding.arm + embedding.share.unsqueeze(-1) * shift.reshape(*shape, 3)
    return embedding.base + moved.sum(-2), turned
