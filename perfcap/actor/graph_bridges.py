"""Edges of a deformation graph between parts of a template that share no vertex.

A skirt, an eye or a shoe is a part of its own: along the surface nothing holds it. The rule here
hangs every part on the larger ones where it touches them in the rest pose, and leaves it free
elsewhere, so that a hem that hangs near a knee does not stick to it:

- a part with a rim (a waistband, a collar, a cuff) touches along its rims, if they fit as closely
  as twice the closest-fitting one; a part without rims touches with its whole surface;
- of those places, the ones touch whose gap to the larger parts is at most twice that of the
  closest ones (the closest quarter of a rim, the closest twentieth of a closed surface);
- where fewer than three nodes of the larger parts would hold a part, their neighbours help, or
  what holds them (a thread on a button on a shirt).

Influences do not cross bridges: a part moves with its own nodes, which the bridges tie.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from perfcap.geometry.surface_topology import SurfaceTopology

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
