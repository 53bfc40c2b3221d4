"""Chosen points of a deformed surface in plain torch; the oracle of the compiled twin."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from perfcap.actor.deformation import Deformation
from perfcap.geometry.rotation import rotvec_to_matrix


class Embedding(NamedTuple):
    """Points without deformation, and their leverage on nodes; see ``EmbeddedPoints``."""

    base: Tensor  # (*b, F, N, 3) m
    blocks: Tensor  # (*b, F, N, k) nodes, -1 for none
    arm: Tensor  # (*b, F, N, k, 3) m, zero where there is no node
    share: Tensor  # (*b, F, N, k), zero where there is no node


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
