"""Chosen points of a deformed surface as compiled loops, for plain tensors on the CPU.

Says the same as ``_embedded_points_torch.py``, which tests hold it equal to.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.actor._embedded_points_torch import Embedding
from perfcap.actor.deformation import Deformation
from perfcap.actor.deformation_graph import DeformationGraph
from perfcap.geometry._rotation_numba import rotvec_to_matrix
from perfcap.kernels import inner, kernel

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]


def merge(
    graph: DeformationGraph, shares: Tensor, posed: Tensor, corners: Tensor, weights: Tensor
) -> Embedding:
    """See ``_embedded_points_torch.merge``."""
    *lead, count, sides = corners.shape
    slots = sides * shares.shape[-1]
    blocks = corners.new_full((*lead, count, slots), -1)
    base, share = shares.new_zeros(*lead, count, 3), shares.new_zeros(blocks.shape)
    arm = shares.new_zeros(*blocks.shape, 3)
    used = _merge(
        graph.node_vertex.numpy(),
        graph.influences.numpy(),
        shares.detach().contiguous().numpy(),
        _rows(posed, *posed.shape[-2:]),
        _rows(corners, count, sides),
        _rows(weights, count, sides),
        base.flatten(0, -3).numpy(),
        blocks.flatten(0, -3).numpy(),
        arm.flatten(0, -4).numpy(),
        share.flatten(0, -3).numpy(),
    )
    parts = (x.narrow(len(lead) + 1, 0, used).contiguous() for x in (blocks, arm, share))
    return Embedding(base, *parts)


def place(embedding: Embedding, deformation: Deformation) -> Tensor:
    """See ``_embedded_points_torch.place``."""
    return _place_points(embedding, deformation)[0]


def linearize(
    embedding: Embedding, deformation: Deformation, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """See ``_embedded_points_torch.linearize``."""
    points, turned = _place_points(embedding, deformation)
    count, along = directions.shape[-3:-1]
    derivative = embedding.arm.new_empty(*embedding.arm.shape[:-1], along, 6)
    _derive(
        turned,
        _rows(embedding.share, *embedding.share.shape[-2:]),
        _rows(directions, count, along, 3),
        derivative.flatten(0, -5).numpy(),
    )
    return points, derivative


def _place_points(embedding: Embedding, deformation: Deformation) -> tuple[Tensor, Floats]:
    """Points, and the arms that their nodes have turned, (P, N, k, 3)."""
    points = embedding.base.new_empty(embedding.base.shape)
    count, slots = embedding.blocks.shape[-2:]
    arm = _rows(embedding.arm, count, slots, 3)
    turned = np.empty_like(arm)
    _place(
        _rows(embedding.base, count, 3),
        _rows(embedding.blocks, count, slots),
        arm,
        _rows(embedding.share, count, slots),
        _rows(deformation.rotation, deformation.nodes, 3),
        _rows(deformation.translation, deformation.nodes, 3),
        turned,
        points.flatten(0, -3).numpy(),
    )
    return points, turned


def _rows(tensor: Tensor, *shape: int) -> NDArray[Any]:
    """(P, *shape), contiguous, as another memory layout would compile the kernels once more."""
    rows = tensor.detach().flatten(0, tensor.dim() - len(shape) - 1)
    return np.ascontiguousarray(rows.numpy())


@kernel()
def _merge(
    node_vertex: Indices,
    influences: Indices,
    shares: Floats,
    posed: Floats,
    corners: Indices,
    weights: Floats,
    base: Floats,
    blocks: Indices,
    arm: Floats,
    share: Floats,
) -> int:
    """Write what every point sees; returns the most nodes that one does."""
    most = 0
    for p in range(len(corners)):
        for n in range(corners.shape[1]):
            used = 0
            for s in range(corners.shape[2]):
                vertex, weight = corners[p, n, s], weights[p, n, s]
                for c in range(3):
                    base[p, n, c] += weight * posed[p, vertex, c]
                for k in range(influences.shape[1]):
                    part = weight * shares[vertex, k]
                    if part == 0:
                        continue
                    node = influences[vertex, k]
                    slot, used = _slot_of(node, used, blocks[p, n], share[p, n], arm[p, n])
                    share[p, n, slot] += part
                    for c in range(3):
                        lever = posed[p, vertex, c] - posed[p, node_vertex[node], c]
                        arm[p, n, slot, c] += part * lever
            most = max(most, used)
    return most


@inner()
def _slot_of(node: int, used: int, blocks: Indices, share: Floats, arm: Floats) -> tuple[int, int]:
    """Slot of a node among the used ones, which are sorted, and how many are used with it."""
    slot = 0
    while slot < used and blocks[slot] < node:
        slot += 1
    if slot < used and blocks[slot] == node:
        return slot, used
    for later in range(used, slot, -1):
        blocks[later], share[later] = blocks[later - 1], share[later - 1]
        for c in range(3):  # a slice would take longer than its three numbers
            arm[later, c] = arm[later - 1, c]
    blocks[slot], share[slot] = node, 0
    for c in range(3):
        arm[slot, c] = 0
    return slot, used + 1


@kernel()
def _place(
    base: Floats,
    blocks: Indices,
    arm: Floats,
    share: Floats,
    rotation: Floats,
    translation: Floats,
    turned: Floats,
    points: Floats,
) -> None:
    turn = np.empty((rotation.shape[1], 3, 3), arm.dtype)
    for p in range(len(base)):
        _turn_seen(blocks[p], rotation[p], turn)
        for n in range(base.shape[1]):
            for c in range(3):
                points[p, n, c] = base[p, n, c]
            for a in range(blocks.shape[2]):
                i = blocks[p, n, a]
                if i < 0:
                    turned[p, n, a] = 0
                    continue
                x, y, z = arm[p, n, a, 0], arm[p, n, a, 1], arm[p, n, a, 2]
                for c in range(3):
                    image = turn[i, c, 0] * x + turn[i, c, 1] * y + turn[i, c, 2] * z
                    turned[p, n, a, c] = image
                    shift = share[p, n, a] * translation[p, i, c]
                    points[p, n, c] += image - arm[p, n, a, c] + shift


@inner()
def _turn_seen(blocks: Indices, rotation: Floats, turn: Floats) -> None:
    """Write the rotation matrices of the nodes that any point sees."""
    todo = np.ones(len(rotation), np.bool_)
    for n in range(blocks.shape[0]):
        for a in range(blocks.shape[1]):
            i = blocks[n, a]
            if i >= 0 and todo[i]:
                rotvec_to_matrix(rotation, i, turn[i])
                todo[i] = False


@kernel()
def _derive(turned: Floats, share: Floats, directions: Floats, derivative: Floats) -> None:
    """Write ``turned x direction`` and ``share direction`` side by side, (P, N, k, Q, 6)."""
    problems, points, slots, along, _ = derivative.shape
    for p in range(problems):
        for n in range(points):
            for a in range(slots):
                x, y, z = turned[p, n, a, 0], turned[p, n, a, 1], turned[p, n, a, 2]
                for q in range(along):
                    u, v, w = directions[p, n, q, 0], directions[p, n, q, 1], directions[p, n, q, 2]
                    derivative[p, n, a, q, 0] = y * w - z * v
                    derivative[p, n, a, q, 1] = z * u - x * w
                    derivative[p, n, a, q, 2] = x * v - y * u
                    derivative[p, n, a, q, 3] = share[p, n, a] * u
                    derivative[p, n, a, q, 4] = share[p, n, a] * v
                    derivative[p, n, a, q, 5] = share[p, n, a] * w
