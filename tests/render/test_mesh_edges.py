"""Edges and the triangles beside them, with seams, borders and faults of the mesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from perfcap.errors import InputError
from perfcap.render.occluding_contour import MeshEdges


def test_closed_mesh_has_two_triangles_at_every_edge() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    edges = MeshEdges.build(mesh.faces)
    assert len(edges.vertices) == len(mesh.faces) * 3 // 2
    assert (edges.sides >= 0).all()
    assert not edges.turned.any()
    for k in range(2):
        corners = np.concatenate([edges.vertices, edges.opposite[:, k : k + 1]], 1)
        np.testing.assert_array_equal(np.sort(corners, 1), np.sort(mesh.faces[edges.sides[:, k]]))


def test_seams_are_no_border() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=1)
    split = np.arange(3 * len(mesh.faces)).reshape(-1, 3)  # every triangle has its own vertices
    assert (MeshEdges.build(split).sides[:, 1] < 0).all()
    welded = MeshEdges.build(split, mesh.faces.reshape(-1))
    assert len(welded.vertices) == len(mesh.faces) * 3 // 2
    assert (welded.sides >= 0).all()
    first = welded.faces[welded.sides[:, 0]]
    assert all(np.isin(pair, row).all() for pair, row in zip(welded.vertices, first, strict=True))


def test_border_of_an_open_mesh() -> None:
    edges = MeshEdges.build(np.array([[0, 1, 2], [2, 1, 3]]))
    is_open = edges.sides[:, 1] < 0
    assert is_open.sum() == 4
    assert {tuple(sorted(pair)) for pair in edges.vertices[~is_open]} == {(1, 2)}
    np.testing.assert_array_equal(np.sort(edges.opposite[~is_open][0]), [0, 3])


def test_three_triangles_at_an_edge_and_one_turned_over() -> None:
    fan = MeshEdges.build(np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    pairs = fan.sides[fan.sides[:, 1] >= 0]
    np.testing.assert_array_equal(pairs, [[0, 1], [1, 2]])
    turned = MeshEdges.build(np.array([[0, 1, 2], [0, 1, 3]]))
    assert turned.turned.sum() == 1


def test_triangles_without_three_places_have_no_edges() -> None:
    edges = MeshEdges.build(np.array([[0, 1, 1], [0, 1, 2], [3, 0, 4]]), np.array([0, 1, 2, 0, 3]))
    assert set(edges.sides.ravel()) == {1, -1}
    assert len(MeshEdges.build(np.zeros((0, 3), np.int64)).vertices) == 0


@pytest.mark.parametrize(
    ("faces", "weld", "words"),
    [
        (np.zeros((2, 4), int), None, "faces has shape"),
        (np.zeros((2, 3)), None, "dtype float64"),
        (np.array([[0, 1, -2]]), None, "vertex -2"),
        (np.array([[0, 1, 5]]), np.arange(4), "weld has shape"),
        (np.array([[0, 1, 2]]), np.array([0, -1, 1]), "weld has shape"),
    ],
)
def test_bad_input(faces: np.ndarray, weld: np.ndarray | None, words: str) -> None:
    with pytest.raises(InputError, match=words):
        MeshEdges.build(faces, weld)
