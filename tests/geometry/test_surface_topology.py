"""Connectivity of clean and of broken meshes."""

import numpy as np
import pytest
import trimesh

from perfcap.errors import InputError
from perfcap.geometry.surface_topology import surface_topology

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


def split(vertices, faces):
    """Every corner a vertex of its own, as at seams everywhere."""
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def test_box_is_closed():
    box = trimesh.creation.box()
    topology = surface_topology(box.vertices, box.faces)
    assert (topology.places, len(topology.edges), topology.components) == (8, 18, 1)
    assert not topology.boundary.any()
    assert not topology.non_manifold.any()
    assert (topology.boundary_loops() == -1).all()
    for edge, pair in zip(topology.edges, topology.edge_faces, strict=True):
        assert all(set(edge) <= set(topology.faces[face]) for face in pair)
        assert pair[0] != pair[1]


def test_counts_say_what_is_odd():
    box = trimesh.creation.box()
    wing = np.array([[*box.faces[0][:2], 8]])
    vertices = np.concatenate((box.vertices, [[3, 3, 3], [4, 4, 4]], box.vertices[:1]))
    assert surface_topology(vertices, np.concatenate((box.faces, wing, [[0, 0, 1]]))).counts() == {
        "triangles": 13,
        "parts": 1,
        "open_edges": 2,
        "edges_of_many_triangles": 1,
        "vertices_at_one_place": 1,
        "places_of_no_triangle": 1,
    }


def test_split_vertices_are_one_place():
    ball = trimesh.creation.icosphere(2)
    whole = surface_topology(ball.vertices, ball.faces)
    vertices, faces = split(ball.vertices, ball.faces)
    vertices[::2] *= np.where(vertices[::2] == 0, -1, 1)  # zeros of either sign
    torn = surface_topology(vertices, faces)
    assert torn.places == whole.places
    assert len(torn.edges) == len(whole.edges)
    assert torn.components == 1
    assert not torn.boundary.any()
    np.testing.assert_array_equal(vertices[torn.representative][torn.place], vertices)
    assert (np.diff(torn.representative) > 0).all()


def test_hole_is_a_loop():
    ball = trimesh.creation.icosphere(2)
    topology = surface_topology(ball.vertices, ball.faces[1:])
    loops = topology.boundary_loops()
    assert topology.boundary.sum() == 3
    assert set(np.flatnonzero(loops == 0)) == set(topology.place[ball.faces[0]])
    assert (topology.edge_faces[topology.boundary] == -1).all()


def test_two_rims_are_two_loops():
    tube = trimesh.creation.cylinder(1, 1, sections=8, cap=False)
    sides = np.array([f for f in tube.faces if np.abs(tube.vertices[f][:, :2]).sum(1).min() > 0.1])
    topology = surface_topology(tube.vertices, sides)
    loops = topology.boundary_loops()
    height = tube.vertices[topology.representative][:, 2]
    assert set(loops) - {-1} == {0, 1}
    assert {len(set(height[loops == loop])) for loop in (0, 1)} == {1}


def test_sheets_may_meet_in_one_edge():
    vertices = np.concatenate((SQUARE, [[0.5, 0.5, 1.0]]))
    faces = np.concatenate((HALVES, [[0, 2, 4]]))
    topology = surface_topology(vertices, faces)
    seam = topology.non_manifold
    assert topology.edges[seam].tolist() == [[0, 2]]
    assert topology.edge_uses[seam] == 3
    assert topology.edge_faces[seam].tolist() == [[-1, -1]]
    assert topology.components == 1


def test_degenerate_triangles_are_left_out():
    vertices = np.concatenate((SQUARE, SQUARE[:1]))
    faces = np.concatenate((HALVES, [[0, 0, 1], [0, 4, 2]]))
    topology = surface_topology(vertices, faces)
    assert len(topology.faces) == 2
    assert len(topology.edges) == 5


def test_parts_are_numbered_by_area_and_lone_vertices_are_none():
    far = SQUARE * 3 + 10
    vertices = np.concatenate((SQUARE, [[5.0, 5, 5]], far))
    topology = surface_topology(vertices, np.concatenate((HALVES, HALVES + 5)))
    assert topology.components == 2
    assert topology.component.tolist() == [1, 1, 1, 1, -1, 0, 0, 0, 0]


def test_one_rings_are_mutual():
    ball = trimesh.creation.icosphere(1)
    topology = surface_topology(ball.vertices, ball.faces)
    start, neighbor = topology.one_rings()
    pairs = {(p, int(q)) for p in range(42) for q in neighbor[start[p] : start[p + 1]]}
    assert len(pairs) == 2 * len(topology.edges)
    assert pairs == {(q, p) for p, q in pairs}
    assert pairs >= {tuple(edge) for edge in topology.edges.tolist()}


def test_no_triangles_is_no_error():
    topology = surface_topology(SQUARE, np.empty((0, 3), np.int64))
    assert topology.components == 0
    assert (topology.component == -1).all()
    assert topology.one_rings()[1].size == 0


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE[:, :2], HALVES, "vertices have shape"),
        (np.empty((0, 3)), np.empty((0, 3), np.int64), "vertices have shape"),
        (SQUARE, HALVES.astype(float), "faces are float64"),
        (SQUARE, HALVES[:, :2], "faces are int64 of shape"),
        (SQUARE, HALVES + 1, "name vertices 1 to 4"),
        (SQUARE, HALVES - 1, "name vertices -1 to 2"),
        (np.where(SQUARE == 1, np.nan, SQUARE), HALVES, "vertex 1 .3 such"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, faces, message):
    with pytest.raises(InputError, match=message):
        surface_topology(vertices, faces)
