"""Augmenting paths between two growing trees (Boykov and Kolmogorov 2004), as compiled loops.

Nodes are pixels with at most eight neighbours; direction ``7 - d`` leads back from direction
``d``. Capacities are integers, so that the flow is exact and the cut the same on every machine.
One tree grows from the source, the other from the sink. Where they meet, flow is pushed along the
path; nodes whose edge to their parent is then full are adopted by another parent or set free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

FREE, SOURCE, SINK = 0, 1, 2
ROOT, ORPHAN = 8, 9  # parents that are no direction
_FAR = 1 << 30


class Forest(NamedTuple):
    """The two trees over n nodes, and the queues of the search."""

    neighbor: NDArray[np.int32]  # (n, 8) node in each direction, -1 where there is none
    capacity: NDArray[np.int32]  # (n, 8) what may still flow in each direction
    excess: NDArray[np.int32]  # (n,) what the source (> 0) or the sink (< 0) may still pass
    tree: NDArray[np.uint8]  # (n,) FREE, SOURCE or SINK
    parent: NDArray[np.uint8]  # (n,) direction, ROOT or ORPHAN
    distance: NDArray[np.int32]  # (n,) edges to the root as known at the time of ``stamp``
    stamp: NDArray[np.int32]  # (n,)
    queued: NDArray[np.bool_]  # (n,) whether the node waits in ``active``
    active: NDArray[np.int32]  # (n,) ring of nodes that may still grow
    orphans: NDArray[np.int32]  # (n,) ring
    ends: NDArray[np.int64]  # (4,) first of ``active``, its count; first of ``orphans``, its count


@kernel()
def is_network(neighbor: NDArray[np.int32], capacity: NDArray[np.int32]) -> bool:
    """Whether neighbours lead back to each other, and capacities are those of neighbours."""
    for node in range(len(neighbor)):
        for direction in range(8):
            other, back = neighbor[node, direction], 7 - direction
            if capacity[node, direction] < 0 or (other < 0 and capacity[node, direction] != 0):
                return False
            if other < 0:
                continue
            if other >= len(neighbor) or (other > node) != (direction > back):
                return False
            if neighbor[other, back] != node:
                return False
    return True


@kernel()
def settle_lines(
    neighbor: NDArray[np.int32],
    capacity: NDArray[np.int32],
    excess: NDArray[np.int32],
    direction: int,
    moved: NDArray[np.int32],
) -> int:
    """Cancel excess against lack along the lines of a direction (4 to 7), in place.

    What is carried on and meets nothing is carried back. Neighbours in these directions have
    greater numbers. Room for what is ``moved``, (n,), is overwritten; returns the flow.
    """
    back, settled = 7 - direction, 0
    moved[:] = 0
    for node in range(len(excess)):
        other, rest = neighbor[node, direction], excess[node]
        if other < 0 or rest == 0:
            continue
        flow = (
            min(rest, capacity[node, direction]) if rest > 0 else -min(-rest, capacity[other, back])
        )
        settled += max(min(abs(flow), -excess[other] if flow > 0 else excess[other]), 0)
        capacity[node, direction] -= flow
        capacity[other, back] += flow
        excess[node] -= flow
        excess[other] += flow
        moved[other] = flow
    for node in range(len(excess) - 1, -1, -1):
        rest, flow = excess[node], moved[node]
        if rest * flow <= 0:
            continue
        flow = min(rest, flow) if flow > 0 else max(rest, flow)
        other = neighbor[node, back]
        capacity[node, back] -= flow
        capacity[other, direction] += flow
        excess[node] -= flow
        excess[other] += flow
    return settled


@kernel()
def run(forest: Forest) -> int:
    """Push the greatest flow; afterwards ``tree`` is SOURCE on the source's side of the cut."""
    ends = forest.ends
    flow, time = 0, 0
    for node in range(len(forest.excess)):
        excess = forest.excess[node]
        if excess != 0:
            forest.tree[node] = SOURCE if excess > 0 else SINK
            forest.parent[node] = ROOT
            forest.distance[node] = 1
    for node in range(len(forest.excess)):  # others have nothing to grow into
        if forest.tree[node] != FREE and _on_edge(forest, node):
            _activate(forest, node)
    while ends[1] > 0:
        node = forest.active[ends[0]]
        direction = _grow(forest, node) if forest.tree[node] != FREE else -1
        if direction < 0:  # nothing left to reach from here
            forest.queued[node] = False
            _drop_first(ends, 0, len(forest.active))
            continue
        time += 1
        flow += _augment(forest, node, direction)
        while ends[3] > 0:
            orphan = forest.orphans[ends[2]]
            _drop_first(ends, 2, len(forest.orphans))
            _adopt(forest, orphan, time)
    return flow


@inner()
def _on_edge(forest: Forest, node: int) -> bool:
    """Whether any neighbour is not in the same tree."""
    tree = forest.tree[node]
    for direction in range(8):
        other = forest.neighbor[node, direction]
        if other >= 0 and forest.tree[other] != tree:
            return True
    return False


@inner()
def _drop_first(ends: NDArray[np.int64], ring: int, size: int) -> None:
    ends[ring] = ends[ring] + 1 if ends[ring] + 1 < size else 0
    ends[ring + 1] -= 1


@inner()
def _activate(forest: Forest, node: int) -> None:
    if not forest.queued[node]:
        forest.queued[node] = True
        place = forest.ends[0] + forest.ends[1]
        if place >= len(forest.active):  # a remainder takes longer
            place -= len(forest.active)
        forest.active[place] = node
        forest.ends[1] += 1


@inner()
def _release(forest: Forest, node: int) -> None:
    forest.parent[node] = ORPHAN
    place = forest.ends[2] + forest.ends[3]
    if place >= len(forest.orphans):
        place -= len(forest.orphans)
    forest.orphans[place] = node
    forest.ends[3] += 1


@inner()
def _grow(forest: Forest, node: int) -> int:
    """Reach for free neighbours; the direction of a neighbour in the other tree, or -1."""
    tree = forest.tree[node]
    for direction in range(8):
        other = forest.neighbor[node, direction]
        if other < 0:
            continue
        theirs = forest.tree[other]
        if theirs == tree:
            continue
        if tree == SOURCE:
            capacity = forest.capacity[node, direction]
        else:
            capacity = forest.capacity[other, 7 - direction]
        if capacity == 0:
            continue
        if theirs != FREE:
            return direction
        forest.tree[other] = tree
        forest.parent[other] = 7 - direction
        forest.stamp[other] = forest.stamp[node]
        forest.distance[other] = forest.distance[node] + 1
        _activate(forest, other)
    return -1


@inner()
def _augment(forest: Forest, node: int, direction: int) -> int:
    """Fill the path through the edge where the trees meet; returns the flow it took."""
    other = forest.neighbor[node, direction]
    if forest.tree[node] == SINK:
        node, other, direction = other, node, 7 - direction
    flow = _bottleneck(forest, node, other, direction)
    forest.capacity[node, direction] -= flow
    forest.capacity[other, 7 - direction] += flow
    while forest.parent[node] != ROOT:
        up = forest.parent[node]
        above = forest.neighbor[node, up]
        forest.capacity[node, up] += flow
        forest.capacity[above, 7 - up] -= flow
        if forest.capacity[above, 7 - up] == 0:
            _release(forest, node)
        node = above
    forest.excess[node] -= flow
    if forest.excess[node] == 0:
        _release(forest, node)
    while forest.parent[other] != ROOT:
        up = forest.parent[other]
        above = forest.neighbor[other, up]
        forest.capacity[other, up] -= flow
        forest.capacity[above, 7 - up] += flow
        if forest.capacity[other, up] == 0:
            _release(forest, other)
        other = above
    forest.excess[other] += flow
    if forest.excess[other] == 0:
        _release(forest, other)
    return int(flow)


@inner()
def _bottleneck(forest: Forest, node: int, other: int, direction: int) -> int:
    """What can flow from the source over ``node`` and ``other`` to the sink."""
    least = forest.capacity[node, direction]
    while forest.parent[node] != ROOT:
        up = forest.parent[node]
        node = forest.neighbor[node, up]
        least = min(least, forest.capacity[node, 7 - up])
    least = min(least, forest.excess[node])
    while forest.parent[other] != ROOT:
        up = forest.parent[other]
        least = min(least, forest.capacity[other, up])
        other = forest.neighbor[other, up]
    return int(min(least, -forest.excess[other]))


@inner()
def _adopt(forest: Forest, orphan: int, time: int) -> None:
    """Find the orphan a parent that leads to the root, the nearest, or set it free."""
    tree = forest.tree[orphan]
    best, nearest = -1, _FAR
    for direction in range(8):
        other = forest.neighbor[orphan, direction]
        if other < 0 or forest.tree[other] != tree:
            continue
        if not _carries(forest, orphan, direction, other, tree):
            continue
        distance = _distance_to_root(forest, other, time)
        if distance < nearest:
            best, nearest = direction, distance
    if best >= 0:
        forest.parent[orphan] = best
        forest.stamp[orphan] = time
        forest.distance[orphan] = nearest + 1
        return
    for direction in range(8):
        other = forest.neighbor[orphan, direction]
        if other < 0 or forest.tree[other] != tree:
            continue
        if _carries(forest, orphan, direction, other, tree):
            _activate(forest, other)
        if forest.parent[other] == 7 - direction:
            _release(forest, other)
    forest.tree[orphan] = FREE


@inner()
def _carries(forest: Forest, node: int, direction: int, other: int, tree: int) -> bool:
    """Whether the tree could reach ``node`` from ``other``."""
    if tree == SOURCE:
        return bool(forest.capacity[other, 7 - direction] > 0)
    return bool(forest.capacity[node, direction] > 0)


@inner()
def _distance_to_root(forest: Forest, node: int, time: int) -> int:
    """Edges to the root, _FAR if there is none; remembers the answer along the way."""
    distance, at = 0, node
    while forest.stamp[at] != time:
        distance += 1
        up = forest.parent[at]
        if up == ORPHAN:
            return _FAR
        if up == ROOT:
            forest.stamp[at] = time
            forest.distance[at] = 1
            break
        at = forest.neighbor[at, up]
    else:
        distance += forest.distance[at]
    steps = distance
    at = node
    while forest.stamp[at] != time:
        forest.stamp[at] = time
        forest.distance[at] = steps
        steps -= 1
        at = forest.neighbor[at, forest.parent[at]]
    return distance
