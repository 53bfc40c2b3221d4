"""Fewer triangles by half-edge collapses: the vertices that stay are not moved.

Quadric error metric of Garland and Heckbert (1997), with vertices on texture seams and borders
kept. Because the result is a subset of the vertices, weights and coordinates need no transfer.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LEAST_COSINE = 0.3  # a collapse may not turn a triangle further than this


def simplify(
    vertices: Floats, faces: Integers, face_uv: Integers, importance: Floats, target: int
) -> Integers:
    """Triangles to keep.

    Args:
        vertices: (V, 3).
        faces: (T, 3).
        face_uv: texture corners of the triangles, (T, 3).
        importance: factor on the cost of removing a vertex, (V,).
        target: number of triangles to reach, if possible.

    Returns:
        (K, 2, 3): vertices and texture corners of the remaining triangles.
    """
    mesh = _Mesh(vertices, faces, face_uv, importance)
    heap = [entry for vertex in mesh.movable for entry in mesh.candidates(vertex)]
    heapq.heapify(heap)
    while heap and mesh.count > target:
        _, vertex, neighbour, stamp = heapq.heappop(heap)
        if mesh.stamp[vertex] != stamp or not mesh.may_collapse(vertex, neighbour):
            continue
        for touched in mesh.collapse(vertex, neighbour):
            if touched in mesh.movable:
                for entry in mesh.candidates(touched):
                    heapq.heappush(heap, entry)
    alive = [face for face in mesh.faces if face is not None]
    return np.array([[[c[0] for c in face], [c[1] for c in face]] for face in alive])


class _Mesh:
    """Triangles as lists of (vertex, texture corner), with the triangles around each vertex."""

    def __init__(
        self, vertices: Floats, faces: Integers, face_uv: Integers, importance: Floats
    ) -> None:
        self.vertices = vertices
        self.importance = importance
        corners = np.stack([faces, face_uv], -1).tolist()
        self.faces: list[list[list[int]] | None] = corners
        self.count = len(corners)
        self.around: list[set[int]] = [set() for _ in vertices]
        for number, face in enumerate(corners):
            for vertex, _ in face:
                self.around[vertex].add(number)
        self.quadrics = _quadrics(vertices, faces)
        self.stamp = [0] * len(vertices)
        self.movable = {v for v in range(len(vertices)) if self._is_interior(v)}

    def _is_interior(self, vertex: int) -> bool:
        corners = [c for f in self.around[vertex] for c in self._face(f)]
        others = [c[0] for c in corners if c[0] != vertex]
        is_closed = bool(others) and all(others.count(other) == 2 for other in set(others))
        return is_closed and len({c[1] for c in corners if c[0] == vertex}) == 1

    def _face(self, number: int) -> list[list[int]]:
        face = self.faces[number]
        assert face is not None
        return face

    def _triangle(self, number: int, vertex: int = -1, onto: int = -1) -> list[Floats]:
        """Corners of a triangle, with one vertex replaced by another."""
        return [self.vertices[onto if c[0] == vertex else c[0]] for c in self._face(number)]

    def neighbours(self, vertex: int) -> set[int]:
        return {c[0] for f in self.around[vertex] for c in self._face(f)} - {vertex}

    def candidates(self, vertex: int) -> list[tuple[float, int, int, int]]:
        """The cheapest collapses of a vertex; a few, since the best may be forbidden."""
        self.stamp[vertex] += 1
        near = sorted(self.neighbours(vertex))
        points = np.c_[self.vertices[near], np.ones(len(near))]
        cost = np.einsum("ni,ij,nj->n", points, self.quadrics[vertex], points)
        length = ((points[:, :3] - self.vertices[vertex]) ** 2).sum(1)
        cost = (np.maximum(cost, 0) + 1e-4 * length * length) * self.importance[vertex]
        best = np.argsort(cost, kind="stable")[:3]
        return [(float(cost[k]), vertex, near[k], self.stamp[vertex]) for k in best]

    def may_collapse(self, vertex: int, onto: int) -> bool:
        """Whether the surface stays a surface and no triangle turns over."""
        if onto not in self.neighbours(vertex):
            return False
        if len(self.neighbours(vertex) & self.neighbours(onto)) != 2:
            return False
        moved = [f for f in self.around[vertex] if f not in self.around[onto]]
        before = np.array([self._triangle(f) for f in moved])
        after = np.array([self._triangle(f, vertex, onto) for f in moved])
        old, new = _unit_normals(before), _unit_normals(after)
        return bool(((old * new).sum(1) > _LEAST_COSINE).all())

    def collapse(self, vertex: int, onto: int) -> set[int]:
        """Merge a vertex into a neighbour; returns the vertices whose costs changed."""
        shared = self.around[vertex] & self.around[onto]
        corner = next(c for f in shared for c in self._face(f) if c[0] == onto)
        touched = self.neighbours(vertex)
        for number in list(self.around[vertex]):
            face = self._face(number)
            if number in shared:
                for c in face:
                    self.around[c[0]].discard(number)
                self.faces[number] = None
            else:
                self.faces[number] = [list(corner) if c[0] == vertex else c for c in face]
                self.around[onto].add(number)
        self.count -= len(shared)
        self.around[vertex] = set()
        self.stamp[vertex] += 1
        self.quadrics[onto] += self.quadrics[vertex]
        return touched


def _quadrics(vertices: Floats, faces: Integers) -> Floats:
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    normal = cross / np.maximum(area, 1e-15)[:, None]
    plane = np.c_[normal, -(normal * corners[:, 0]).sum(1)]
    quadric = area[:, None, None] * plane[:, :, None] * plane[:, None, :]
    total = np.zeros((len(vertices), 4, 4))
    np.add.at(total, faces, quadric[:, None])
    return total


def _unit_normals(triangles: Floats) -> Floats:
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return cross / np.maximum(length, 1e-15)
