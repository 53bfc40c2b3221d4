"""Line of sight against brute force."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from perfcap.errors import InputError
from perfcap.rigging.bone_heat import Sight


def test_agrees_with_every_triangle_tested() -> None:
    random = np.random.default_rng(4)
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    starts, ends = random.uniform(-0.8, 0.8, (2, 300, 3))
    own = np.full(300, -1)
    found = Sight(vertices, faces).blocked(starts, ends, own)
    expected = [any_hit(s, e, vertices[faces]) for s, e in zip(starts, ends, strict=True)]
    assert found.tolist() == expected
    assert 30 < found.sum() < 270


def any_hit(start: np.ndarray, end: np.ndarray, corners: np.ndarray) -> bool:
    """Solve start + t (end - start) = a + u (b - a) + v (c - a) for each triangle."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ray = np.broadcast_to(end - start, a.shape)
    matrix = np.stack((ray, a - b, a - c), -1)
    t, u, v = np.linalg.solve(matrix, (a - start)[..., None])[..., 0].T
    return bool(((t > 0) & (t < 1) & (u >= 0) & (v >= 0) & (u + v <= 1)).any())


def test_a_vertex_is_not_hidden_by_its_own_triangles() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    centre = np.zeros_like(vertices)
    assert not Sight(vertices, faces).blocked(vertices, centre, np.arange(len(vertices))).any()
    across = Sight(vertices, faces).blocked(vertices, -1.5 * vertices, np.arange(len(vertices)))
    assert across.all()


def test_points_outside_the_grid_are_walked() -> None:
    mesh = trimesh.creation.box((1, 1, 1))
    sight = Sight(np.asarray(mesh.vertices, float), np.asarray(mesh.faces))
    starts = np.array([[0.1, 0.2, 0.0], [3.0, 0.0, 0.1]])
    ends = np.array([[0.1, 0.2, 4.0], [3.0, 1.0, 0.1]])
    assert sight.blocked(starts, ends, np.array([-1, -1])).tolist() == [True, False]


def test_what_is_no_mesh_or_no_points_is_refused() -> None:
    """Compiled loops read beyond the end of arrays."""
    mesh = trimesh.creation.icosphere(subdivisions=0)
    places, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    for given, message in (
        ((np.nan * places, faces), "places are not all finite"),
        ((places, faces + 1), "faces names places 1 to 12"),
        ((places, faces[:, :2]), "faces has shape"),
    ):
        with pytest.raises(InputError, match=message):
            Sight(*given)
    sight, own = Sight(places, faces), np.full(12, -1)
    for given, message in (
        ((places, places[:1], own), "ends has shape"),
        ((places, places, own[:1]), "own has shape"),
        ((places, places + np.inf, own), "ends are not all finite"),
    ):
        with pytest.raises(InputError, match=message):
            sight.blocked(*given)
