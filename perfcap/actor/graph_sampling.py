"""Nodes on a template's surface, who neighbours whom, and which vertices each one moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from perfcap.errors import InputError
from perfcap.geometry.geodesic import surface_paths
from perfcap.geometry.surface_topology import SurfaceTopology, surface_topology

# --- Edges of a deformation graph between parts of a template that share no vertex ----------------
#
# A skirt, an eye or a shoe is a part of its own: along the surface nothing holds it. The rule here
# hangs every part on the larger ones where it touches them in the rest pose, and leaves it free
# elsewhere, so that a hem that hangs near a knee does not stick to it:
#
# - a part with a rim (a waistband, a collar, a cuff) touches along its rims, if they fit as closely
#   as twice the closest-fitting one; a part without rims touches with its whole surface;
# - of those places, the ones touch whose gap to the larger parts is at most twice that of the
#   closest ones (the closest quarter of a rim, the closest twentieth of a closed surface);
# - where fewer than three nodes of the larger parts would hold a part, their neighbours help, or
#   what holds them (a thread on a button on a shirt).
#
# Influences do not cross bridges: a part moves with its own nodes, which the bridges tie.

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

SLACK = 2.0  # gaps up to this many times the closest ones touch
RIM_QUANTILE = 0.25
SURFACE_QUANTILE = 0.05
RIM_SHARE = 0.25  # rims of fewer places than this share of the largest are holes, not rims
HOLDERS = 3  # nodes that fix a place in space, unless on a line


def bridge(positions: Floats, topology: SurfaceTopology, nearest: Integers) -> Integers:
    """Pairs of nodes that tie each part to larger ones.

    Args:
        positions: of the places, (U, 3), metres, rest pose.
        topology: its ``component`` numbers parts by falling area.
        nearest: nodes near each place, nearest first, -1 where there are fewer, (U, N).

    Returns:
        (P, 2), lower first, each once.
    """
    part = np.where(nearest[:, 0] >= 0, topology.component, -1)
    loops = topology.boundary_loops()
    found = np.empty((0, 2), dtype=np.int64)  # node held, node that holds it
    for index in range(1, int(part.max()) + 1):
        own = np.flatnonzero(part == index)
        larger = np.flatnonzero((part >= 0) & (part < index))
        gap, at = _gaps(positions[own], positions[larger])
        touches = _touching(gap, loops[own])
        links = _links(nearest, own[touches], larger[at[touches]])
        found = np.concatenate((found, links, _behind(links, found)))
    return np.unique(np.sort(found, 1), axis=0)


def _gaps(points: Floats, others: Floats) -> tuple[Floats, Integers]:
    """Distance (N,) of each point to the nearest of others, and which that is (N,)."""
    low, high = points.min(0), points.max(0)
    outside = np.linalg.norm(others - np.clip(others, low, high), axis=1)
    # no point of the box can be nearer to any other, so many small parts stay cheap
    near = np.flatnonzero(outside <= outside.min() + np.linalg.norm(high - low) * (1 + 1e-9))
    gap, at = cKDTree(others[near]).query(points)
    return gap, near[at]


def _touching(gap: Floats, loops: Integers) -> Flags:
    """Which places of a part touch the larger parts, (N,); at least one.

    Args:
        gap: from each place, (N,) metres.
        loops: rim each place is on, -1 for none, (N,).
    """
    if not (loops >= 0).any():
        return np.asarray(gap <= SLACK * np.quantile(gap, SURFACE_QUANTILE))
    counts = np.bincount(loops[loops >= 0])
    rims = np.flatnonzero(counts >= RIM_SHARE * counts.max())
    fits = np.array([np.quantile(gap[loops == rim], RIM_QUANTILE) for rim in rims])
    snug = fits <= SLACK * fits.min()
    reach = np.full(len(counts), -1.0)
    reach[rims[snug]] = SLACK * fits[snug]
    return np.asarray((loops >= 0) & (gap <= reach[loops]))


def _links(nearest: Integers, own: Integers, other: Integers) -> Integers:
    """Nodes held and holding (P, 2) where places of a part touch places of others, (N,) each."""
    width = 1 if len(np.unique(nearest[other, 0])) >= HOLDERS else HOLDERS
    holders = nearest[other, :width]
    pairs = np.stack((np.broadcast_to(nearest[own, :1], holders.shape), holders), -1)
    return pairs[holders >= 0]


def _behind(links: Integers, found: Integers) -> Integers:
    """Links (P, 2) to what holds the holders, where those alone are too few."""
    held, holders = np.unique(links[:, 0]), np.unique(links[:, 1])
    if len(holders) >= HOLDERS:
        return found[:0]
    second = np.unique(found[np.isin(found[:, 0], holders), 1])
    return np.stack(np.meshgrid(held, second), -1).reshape(-1, 2)


# --- Nodes on a template's surface, who neighbours whom, and which vertices each one moves --------

SHARPNESS = 3.0  # of the fall-off; measured, see DeformationGraph.build
BRACES = 3  # neighbours that keep a node from spinning
SEED_SHARE = 0.5  # of the nodes may go to parts as their only one


@dataclass(frozen=True, eq=False)
class GraphLayout:
    """A deformation graph as arrays; see ``DeformationGraph`` for what they mean."""

    node_vertex: Integers
    edges: Integers
    influences: Integers
    influence_weights: Floats
    radius: Floats


@dataclass(frozen=True, eq=False)
class Cells:
    """The surface divided among nodes.

    Attributes:
        nodes: place of each node, (M,).
        distance: from each place to its nearest nodes along the surface, (U, N) metres, inf
            where fewer are reached.
        nearest: those nodes, nearest first, -1 where fewer are reached, (U, N).
    """

    nodes: Integers
    distance: Floats
    nearest: Integers

    @property
    def owner(self) -> Integers:
        """Nearest node of each place, (U,), -1 where none is reached."""
        return self.nearest[:, 0]


def lay_out(vertices: Floats, faces: Integers, nodes: int, influences: int) -> GraphLayout:
    """Build a deformation graph; see ``DeformationGraph.build``."""
    if nodes < 1 or influences < 1:
        raise InputError(f"nodes is {nodes} and influences {influences}; give at least 1 of each")
    topology = surface_topology(vertices, faces)
    if not topology.components:
        raise InputError(
            f"the mesh has {len(faces)} triangles and none of three distinct corners; a "
            "deformation graph needs a surface"
        )
    positions = np.asarray(vertices, np.float64)[topology.representative]
    cells = divide(positions, topology, nodes, influences)
    pairs, lengths = _braced(cells, *_adjacency(positions, topology, cells))
    bridges = bridge(positions, topology, cells.nearest)
    radius = _radii(positions[cells.nodes], pairs, lengths, bridges)
    index, weights = _influences(positions, cells, radius, influences)
    return GraphLayout(
        node_vertex=topology.representative[cells.nodes],
        edges=_directed(np.concatenate((pairs, bridges)), len(cells.nodes)),
        influences=index[topology.place],
        influence_weights=weights[topology.place],
        radius=radius,
    )


def divide(positions: Floats, topology: SurfaceTopology, nodes: int, influences: int) -> Cells:
    """Spread nodes over the surface by farthest-point sampling along it, and find the nearest.

    Every part gets one node first, the one nearest its middle, largest parts first and up to half
    of the nodes; the others go wherever the surface is farthest from all before, so parts share
    them by area. One node more than asked for is found for each place: the fall-off ends there.
    """
    paths = surface_paths(positions, topology)
    seeds = _middles(positions, topology)[: max(int(SEED_SHARE * nodes), 1)]
    usable = (topology.component >= 0) & (topology.component < len(seeds))
    picked = paths.farthest(seeds, nodes, usable)
    return Cells(picked, *paths.nearest(picked, influences + 1))


def fall_off(distance: Floats, radius: Floats) -> Floats:
    """Unnormalised influences (..., N) of candidates at a distance (..., N), nearest first.

    ``exp(-3 (d / r)^2)``, lowered so that the weakest candidate has none: where the set of
    candidates changes along the surface, the one that leaves has reached zero, and the surface
    does not crease.
    """
    weight = np.exp(-SHARPNESS * np.square(distance / radius))
    return np.asarray(weight - weight.min(-1, keepdims=True))


def _middles(positions: Floats, topology: SurfaceTopology) -> Integers:
    """The place of each part that is nearest its mean position, (components,)."""
    inside = np.flatnonzero(topology.component >= 0)
    part = topology.component[inside]
    count = np.bincount(part)
    mean = np.stack([np.bincount(part, axis) / count for axis in positions[inside].T], 1)
    off = np.linalg.norm(positions[inside] - mean[part], axis=1)
    order = np.lexsort((off, part))
    first = np.searchsorted(part[order], np.arange(len(count)))
    return inside[order[first]]


def _adjacency(
    positions: Floats, topology: SurfaceTopology, cells: Cells
) -> tuple[Integers, Floats]:
    """Pairs of nodes (P, 2), lower first, whose cells share a mesh edge; distance between (P,).

    The distance is that of the shortest path through the two cells.
    """
    a, b = topology.edges.T
    across = (cells.owner[a] != cells.owner[b]) & (cells.owner[a] >= 0)
    a, b = a[across], b[across]
    through = cells.distance[a, 0] + np.linalg.norm(positions[a] - positions[b], axis=1)
    through += cells.distance[b, 0]
    pairs = np.sort(np.stack((cells.owner[a], cells.owner[b]), 1), 1)
    return _shortest(pairs, through)


def _braced(cells: Cells, pairs: Integers, lengths: Floats) -> tuple[Integers, Floats]:
    """The pairs, and for nodes with fewer than three neighbours those to the nearest three.

    At a fingertip cells follow one another in a row, and neighbours in a row let a node spin.
    """
    degree = np.bincount(pairs.ravel(), minlength=len(cells.nodes))
    loose = np.flatnonzero(degree < BRACES)
    near = cells.nearest[cells.nodes[loose], 1 : 1 + BRACES]
    more = np.stack((np.broadcast_to(loose[:, None], near.shape), near), -1)[near >= 0]
    reach = cells.distance[cells.nodes[loose], 1 : 1 + BRACES][near >= 0]
    return _shortest(np.concatenate((pairs, np.sort(more, 1))), np.concatenate((lengths, reach)))


def _shortest(pairs: Integers, lengths: Floats) -> tuple[Integers, Floats]:
    """Each pair (P, 2) once, sorted, with the least of its lengths (P,)."""
    order = np.lexsort((lengths, pairs[:, 1], pairs[:, 0]))
    pairs, first = np.unique(pairs[order], axis=0, return_index=True)
    return pairs, lengths[order][first]


def _radii(nodes: Floats, pairs: Integers, lengths: Floats, bridges: Integers) -> Floats:
    """Largest distance to a neighbour along the surface (MPC-27), (M,) metres.

    A node alone on its part takes its longest bridge; one alone altogether, any positive number.
    """
    radius = np.zeros(len(nodes))
    np.maximum.at(radius, pairs.ravel(), np.repeat(lengths, 2))
    over = np.linalg.norm(nodes[bridges[:, 0]] - nodes[bridges[:, 1]], axis=1)
    bridged = np.zeros(len(nodes))
    np.maximum.at(bridged, bridges.ravel(), np.repeat(over, 2))
    radius = np.where(radius > 0, radius, bridged)
    return np.where(radius > 0, radius, 1.0)


def _influences(
    positions: Floats, cells: Cells, radius: Floats, count: int
) -> tuple[Integers, Floats]:
    """Nodes (U, K) that move each place and their shares (U, K), heaviest first."""
    reached = cells.nearest >= 0
    nodes = np.where(reached, cells.nearest, cells.nearest[:, :1])
    distance = np.where(reached, cells.distance, np.inf)
    weights = fall_off(distance, radius[nodes])
    # a place whose candidates are all alike, or that has one only, belongs to the nearest
    weights[:, 0] = np.where(weights.sum(1) > 0, weights[:, 0], 1.0)
    order = np.argsort(-weights, axis=1, kind="stable")[:, :count]
    nodes, weights = np.take_along_axis(nodes, order, 1), np.take_along_axis(weights, order, 1)
    weights /= weights.sum(1, keepdims=True)
    held = reached[:, 0]
    if not held.all():  # what no node reaches moves as the nearest place that one does
        _, near = cKDTree(positions[held]).query(positions[~held])
        nodes[~held], weights[~held] = nodes[held][near], weights[held][near]
    return nodes, weights


def _directed(pairs: Integers, nodes: int) -> Integers:
    """Both directions of each pair, once, sorted: (E, 2)."""
    key = np.unique(np.concatenate((pairs @ (nodes, 1), pairs @ (1, nodes))))
    return np.stack((key // nodes, key % nodes), 1)
