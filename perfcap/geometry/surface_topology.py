"""What touches what on a triangle mesh: welded places, edges, one-rings, components.

A file's vertices are split where texture or normals jump, and scans have holes, sheets that meet
in one edge, and triangles without area. None of that stops anything here: connectivity is of
*places*, vertices at one position taken as one, and what is odd is labelled, not refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from perfcap.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SurfaceTopology:
    """Connectivity of a mesh with V vertices at U places.

    Attributes:
        place: the place of each vertex, (V,).
        representative: the first vertex at each place, (U,).
        faces: triangles as places, (T, 3); those that had fewer than three places are left out.
        edges: places of each edge, the lower first, (E, 2), sorted.
        edge_uses: how many triangles meet in each edge, (E,).
        edge_faces: the two triangles of an edge in which two meet, otherwise -1, (E, 2).
        component: connected part each place belongs to, (U,), numbered by falling area;
            -1 for places of no triangle.
    """

    place: Integers
    representative: Integers
    faces: Integers
    edges: Integers
    edge_uses: Integers
    edge_faces: Integers
    component: Integers

    @property
    def places(self) -> int:
        """U."""
        return len(self.representative)

    @property
    def components(self) -> int:
        """Connected parts that have triangles."""
        return int(self.component.max(initial=-1)) + 1

    @property
    def boundary(self) -> Flags:
        """Edges of one triangle: rims and holes, (E,)."""
        return np.asarray(self.edge_uses == 1)

    @property
    def non_manifold(self) -> Flags:
        """Edges in which more than two triangles meet, (E,)."""
        return np.asarray(self.edge_uses > 2)

    def counts(self) -> dict[str, int]:
        """What a user may want to know of a mesh, by name."""
        return {
            "triangles": len(self.faces),
            "parts": self.components,
            "open_edges": int(self.boundary.sum()),
            "edges_of_many_triangles": int(self.non_manifold.sum()),
            "vertices_at_one_place": len(self.place) - self.places,
            "places_of_no_triangle": int((self.component < 0).sum()),
        }

    def one_rings(self) -> tuple[Integers, Integers]:
        """Neighbours of every place, ``neighbor[start[p]:start[p + 1]]``: start (U + 1,)."""
        start, order = group_by(np.concatenate((self.edges[:, 0], self.edges[:, 1])), self.places)
        return start, np.concatenate((self.edges[:, 1], self.edges[:, 0]))[order]

    def boundary_loops(self) -> Integers:
        """Which rim each place is on, (U,), -1 for none; rims that touch are one."""
        rim = self.edges[self.boundary]
        label = _components(rim, self.places)
        on_rim = np.zeros(self.places, dtype=np.bool_)
        on_rim[rim] = True
        _, loops = np.unique(label[on_rim], return_inverse=True)
        result = np.full(self.places, -1, dtype=np.int64)
        result[on_rim] = loops
        return result


def surface_topology(vertices: Floats, faces: Integers) -> SurfaceTopology:
    """Connectivity of triangles (T, 3) over vertices (V, 3).

    Vertices are one place when their coordinates are equal, as copies at texture seams are.

    Raises:
        InputError: the arrays are no mesh, or a coordinate is not finite.
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces)
    _check(vertices, faces)
    place, representative = _weld(vertices)
    corners = place[faces.astype(np.int64)]
    corners = corners[(corners != np.roll(corners, 1, 1)).all(1)]
    edges, uses, edge_faces = _edges(corners, len(representative))
    component = _ranked_components(vertices[representative], corners, edges)
    return SurfaceTopology(place, representative, corners, edges, uses, edge_faces, component)


def face_areas(vertices: Floats, faces: Integers) -> Floats:
    """Area of each triangle, (T,), in square metres."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def group_by(keys: Integers, groups: int) -> tuple[Integers, Integers]:
    """Members of each group, ``order[start[g]:start[g + 1]]``, in their first order.

    Args:
        keys: group of each member, (N,), 0 to ``groups``.
        groups: G.

    Returns:
        start (G + 1,), order (N,).
    """
    start = np.zeros(groups + 1, dtype=np.int64)
    np.cumsum(np.bincount(keys, minlength=groups), out=start[1:])
    return start, np.argsort(keys, kind="stable")


def _weld(vertices: Floats) -> tuple[Integers, Integers]:
    """Place of each vertex (V,) and first vertex of each place (U,), in order of appearance."""
    order = np.lexsort((vertices + 0.0).T)  # -0.0 and 0.0 are one place
    ranked = vertices[order]
    new = np.ones(len(order), dtype=np.bool_)
    new[1:] = (ranked[1:] != ranked[:-1]).any(1)
    first = order[new]  # lexsort is stable, so the lowest index of each place
    by_appearance = np.argsort(first)
    rank = np.empty_like(by_appearance)
    rank[by_appearance] = np.arange(len(first))
    place = np.empty(len(order), dtype=np.int64)
    place[order] = rank[np.cumsum(new) - 1]
    return place, first[by_appearance]


def _edges(faces: Integers, places: int) -> tuple[Integers, Integers, Integers]:
    """Distinct edges (E, 2), the number of triangles of each (E,), and those of pairs (E, 2)."""
    sides = np.sort(np.stack((faces, np.roll(faces, -1, 1)), -1).reshape(-1, 2), 1)
    key = sides[:, 0] * places + sides[:, 1]
    order = np.argsort(key, kind="stable")
    key, first, uses = np.unique(key[order], return_index=True, return_counts=True)
    pairs = np.full((len(key), 2), -1, dtype=np.int64)
    shared = uses == 2
    pairs[shared] = order[first[shared, None] + np.arange(2)] // 3
    return np.stack((key // places, key % places), 1), uses.astype(np.int64), pairs


def _ranked_components(positions: Floats, faces: Integers, edges: Integers) -> Integers:
    label = _components(edges, len(positions))
    area = np.bincount(label[faces[:, 0]], face_areas(positions, faces), label.max() + 1)
    has_faces = np.bincount(label[faces[:, 0]], minlength=len(area)) > 0
    ranked = np.argsort(np.where(has_faces, -area, np.inf), kind="stable")
    rank = np.empty(len(area), dtype=np.int64)
    rank[ranked] = np.arange(len(area))
    return np.where(has_faces[label], rank[label], -1)


def _components(edges: Integers, places: int) -> Integers:
    ones = np.ones(len(edges), dtype=np.bool_)
    graph = coo_array((ones, (edges[:, 0], edges[:, 1])), shape=(places, places))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _check(vertices: Floats, faces: NDArray[np.generic]) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not len(vertices):
        raise InputError(f"vertices have shape {vertices.shape}; give (V, 3), at least one")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(
            f"faces are {faces.dtype} of shape {faces.shape}; give vertex indices (T, 3)"
        )
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise InputError(
            f"faces name vertices {faces.min()} to {faces.max()} but there are {len(vertices)}; "
            "give indices of vertices"
        )
    bad = ~np.isfinite(vertices).all(1)
    if bad.any():
        raise InputError(
            f"vertex {int(np.argmax(bad))} ({int(bad.sum())} such vertices) is not finite; "
            "repair the mesh"
        )
