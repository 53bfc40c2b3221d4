"""Shortest paths along the edges of a graph as compiled loops around a binary heap.

Neighbours of place p are ``neighbor[start[p]:start[p + 1]]``, as far as ``length`` says. Heap
entries are ordered by distance, then by number, so ties do not depend on anything else.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@kernel()
def nearest(
    start: Integers,
    neighbor: Integers,
    length: Floats,
    sources: Integers,
    limit: float,
    distance: Floats,
    source: Integers,
) -> None:
    """Write the K nearest sources of each place and their distances, nearest first.

    A shortest path runs through places that have its source among their own K nearest, so a
    place passes on no more than K.

    Args:
        start: (U + 1,).
        neighbor: (N,).
        length: (N,) metres.
        sources: places, (S,).
        limit: paths longer than this are not followed, metres.
        distance: (U, K), preset to inf, written.
        source: index of a source, (U, K), preset to -1, written.
    """
    most = distance.shape[1]
    found = np.zeros(len(distance), np.int64)
    heap = [(0.0, sources[s], s) for s in range(len(sources))]
    heapq.heapify(heap)
    while heap:
        reached, p, s = heapq.heappop(heap)
        if found[p] == most or _among(source, p, found[p], s):
            continue
        distance[p, found[p]], source[p, found[p]] = reached, s
        found[p] += 1
        for n in range(start[p], start[p + 1]):
            q, beyond = neighbor[n], reached + length[n]
            if beyond <= limit and found[q] < most and not _among(source, q, found[q], s):
                heapq.heappush(heap, (beyond, q, s))


@inner()
def _among(source, p, count, s):  # type: ignore[no-untyped-def]
    """Whether source s is one of the first ``count`` of place p."""
    for k in range(count):  # noqa: SIM110 - compiled, a loop is what a generator is not
        if source[p, k] == s:
            return True
    return False


@kernel()
def farthest(
    start: Integers,
    neighbor: Integers,
    length: Floats,
    picked: Integers,
    given: int,
    distance: Floats,
) -> int:
    """Pick places one after another, each the farthest from those before; return how many.

    Args:
        start: (U + 1,).
        neighbor: (N,).
        length: (N,) metres.
        picked: (M,), the first ``given`` of them set, the others written.
        given: at least one.
        distance: (U,), preset to inf, or to -1 where nothing may be picked; written.
    """
    for count in range(len(picked)):
        if count >= given:
            picked[count] = np.argmax(distance)
            if distance[picked[count]] <= 0:
                return count
        _spread(start, neighbor, length, picked[count], distance)
    return len(picked)


@inner()
def _spread(start, neighbor, length, origin, distance):  # type: ignore[no-untyped-def]
    """Lower ``distance`` to that from ``origin`` wherever it is nearer than what was before."""
    distance[origin] = 0.0
    heap = [(0.0, origin)]
    while heap:
        reached, p = heapq.heappop(heap)
        if reached > distance[p]:
            continue
        for n in range(start[p], start[p + 1]):
            q, beyond = neighbor[n], reached + length[n]
            if beyond < distance[q]:
                distance[q] = beyond
                heapq.heappush(heap, (beyond, q))
