"""Motions that cost little, which local steps find slowly, and the groups of nodes they move."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.array_checks import require_indices, require_shape
from perfcap.kernels import kernel


@dataclass(frozen=True)
class CoarseSpace:
    """Motions of groups of blocks that cost an energy little.

    Args:
        group: group 0 ... C - 1 of each block, -1 for none, (M,).
        groups: C.
        modes: how a block moves along each of the r motions of its group, (*b, F, M, q, r), or
            (P, M, q, r) inside the solver.
    """

    group: Tensor
    groups: int
    modes: Tensor


# --- Groups of neighbouring nodes of a graph ------------------------------------------------------

Indices = NDArray[np.int64]


def aggregate(edges: Indices, nodes: int, groups: int | None = None) -> tuple[Indices, int]:
    """Connected groups of nearly equal extent, counted in edges: the same for the same graph.

    The first node is a centre, and then, again and again, the node farthest from all centres;
    every node belongs to the centre nearest to it. A part of the graph that is not connected to
    the rest gets a centre before any other gets a second.

    Args:
        edges: directed pairs, both directions of each, (E, 2).
        nodes: how many there are.
        groups: how many groups at most, three quarters of the root of their number if None.

    Returns:
        The group of each node, (nodes,), -1 in parts that there was no centre for, and how many
        groups there are.

    Raises:
        InputError: edges of other nodes.
    """
    require_shape(edges, "edges", (None, 2), "(E, 2), directed pairs")
    require_indices(edges, "edges", nodes, "nodes")
    wanted = min(nodes, (3 * math.isqrt(nodes) + 3) // 4 if groups is None else groups)
    ordered = edges[np.argsort(edges[:, 0], kind="stable")]
    first = np.searchsorted(ordered[:, 0], np.arange(nodes + 1))
    group = np.full(nodes, -1, np.int64)
    return group, int(_grow(first, np.ascontiguousarray(ordered[:, 1]), wanted, group))


@kernel()
def _grow(first: Indices, neighbours: Indices, wanted: int, group: Indices) -> int:
    """Write the group of each node; each new centre floods what is nearer to it than to others."""
    nodes = len(group)
    hops = np.full(nodes, nodes, np.int64)
    queue = np.empty(nodes, np.int64)
    for number in range(wanted):
        centre = np.argmax(hops)
        if hops[centre] == 0:
            return number
        hops[centre], group[centre], queue[0] = 0, number, centre
        head, tail = 0, 1
        while head < tail:
            node = queue[head]
            head += 1
            for edge in range(first[node], first[node + 1]):
                other = neighbours[edge]
                if hops[node] + 1 < hops[other]:
                    hops[other], group[other] = hops[node] + 1, number
                    queue[tail] = other
                    tail += 1
    return wanted
