"""A strip of vertices with a few nodes on it."""

from __future__ import annotations

import torch
from torch import Tensor

from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph

VERTICES, NODES = 18, 6


def tiny_graph() -> DeformationGraph:
    """Six nodes on every third vertex, neighbours up to two apart; three nodes move a vertex."""
    node_vertex = torch.arange(0, VERTICES, 3)
    pairs = [(i, j) for i in range(NODES) for j in range(NODES) if 0 < abs(i - j) <= 2]
    near = (torch.arange(VERTICES)[:, None] - node_vertex).abs().double()
    distance, influences = near.topk(3, largest=False)
    share = torch.exp(-0.1 * distance.square())
    share[:3, 2] = 0  # one of the places is not used
    return DeformationGraph(
        node_vertex,
        torch.tensor(pairs),
        influences,
        share / share.sum(-1, keepdim=True),
        torch.full((NODES,), 0.6, dtype=torch.float64),
    )


def posed_strip(batch: tuple[int, ...] = (), frames: int = 2, seed: int = 0) -> Tensor:
    """A bent strip, another in every frame, (*b, F, V, 3)."""
    random = torch.Generator().manual_seed(seed)
    along = torch.linspace(0, 1, VERTICES, dtype=torch.float64)
    strip = torch.stack((along, (3 * along).sin(), 0.2 * (7 * along).cos()), -1)
    noise = torch.randn(*batch, frames, VERTICES, 3, generator=random, dtype=torch.float64)
    return strip + 0.05 * noise


def random_deformation(
    batch: tuple[int, ...] = (), frames: int = 2, size: float = 0.4, seed: int = 1
) -> Deformation:
    """Any rotations and translations."""
    random = torch.Generator().manual_seed(seed)
    shape = (2, *batch, frames, NODES, 3)
    rotation, translation = size * torch.randn(*shape, generator=random, dtype=torch.float64)
    return Deformation(rotation, translation)
