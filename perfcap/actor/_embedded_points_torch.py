"""Chosen points of a deformed surface in plain torch; the oracle of the compiled twin."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from perfcap.actor.deformation import Deformation
from perfcap.geometry.rotation import rotvec_to_matrix, skew


class Embedding(NamedTuple):
    """Points without deformation, and their leverage on nodes; see ``EmbeddedPoints``."""

    base: Tensor  # (*b, F, N, 3) m
    blocks: Tensor  # (*b, F, N, k) nodes, -1 for none
    arm: Tensor  # (*b, F, N, k, 3) m, zero where there is no node
    share: Tensor  # (*b, F, N, k), zero where there is no node


def place(embedding: Embedding, deformation: Deformation) -> Tensor:
    """Points (*b, F, N, 3)."""
    return _place(embedding, deformation)[0]


def linearize(embedding: Embedding, deformation: Deformation) -> tuple[Tensor, Tensor]:
    """Points, and their derivative (*b, F, N, k, 3, 6) in rotations and translations."""
    points, turned = _place(embedding, deformation)
    eye = torch.eye(3).to(turned)
    move = embedding.share[..., None, None] * eye
    return points, torch.cat((-skew(turned), move), -1)


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
