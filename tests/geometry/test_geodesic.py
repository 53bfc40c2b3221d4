"""Distances along surfaces, against scipy's shortest paths and against spheres."""

import numpy as np
import pytest
import trimesh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from perfcap.errors import InputError
from perfcap.geometry.geodesic import SurfacePaths, surface_paths
from perfcap.geometry.surface_topology import surface_topology


def ball(level=3, shake=0.0):
    mesh = trimesh.creation.icosphere(level)
    vertices = np.array(mesh.vertices)
    vertices += shake * np.random.default_rng(3).normal(size=vertices.shape)
    topology = surface_topology(vertices, mesh.faces)
    return vertices, surface_paths(vertices, topology)


def oracle(paths, sources):
    size = len(paths.start) - 1
    matrix = csr_array((paths.length, paths.neighbor, paths.start), shape=(size, size))
    return dijkstra(matrix, indices=sources)


@pytest.mark.parametrize("count", [1, 4])
def test_nearest_agrees_with_scipy(count):
    _, paths = ball(shake=0.01)
    sources = np.array([5, 80, 81, 300, 517, 600])
    distance, source = paths.nearest(sources, count)
    every = oracle(paths, sources)
    np.testing.assert_allclose(distance, np.sort(every, 0)[:count].T, rtol=1e-12)
    np.testing.assert_array_equal(source, np.argsort(every, 0)[:count].T)


def test_nearest_stops_at_the_limit():
    _, paths = ball(shake=0.01)
    sources = np.array([5, 300])
    distance, source = paths.nearest(sources, 2, limit=0.8)
    every = np.sort(oracle(paths, sources), 0).T
    np.testing.assert_array_equal(np.isfinite(distance), every <= 0.8)
    np.testing.assert_array_equal(source >= 0, every <= 0.8)


def test_nearest_knows_what_it_cannot_reach():
    two = trimesh.util.concatenate(
        [trimesh.creation.icosphere(1), trimesh.creation.icosphere(1).apply_translation([9, 0, 0])]
    )
    topology = surface_topology(two.vertices, two.faces)
    paths = surface_paths(two.vertices, topology)
    distance, source = paths.nearest(np.array([0, 1]), 3)
    assert (source[42:] == -1).all()
    assert np.isinf(distance[42:]).all()
    assert (source[:42, :2] >= 0).all()
    assert (source[:42, 2] == -1).all()


@pytest.mark.parametrize(
    ("mesh", "bound"),
    [(trimesh.creation.icosphere(4), 0.02), (trimesh.creation.uv_sphere(count=[32, 64]), 0.04)],
)
def test_distances_on_a_sphere(mesh, bound):
    vertices = np.array(mesh.vertices)
    paths = surface_paths(vertices, surface_topology(vertices, mesh.faces))
    distance, _ = paths.nearest(np.array([7]))
    arc = np.arccos(np.clip(vertices @ vertices[7], -1, 1))
    away = arc > 0.2
    error = distance[away, 0] / arc[away] - 1
    assert error.min() > -0.005  # chords are shorter than arcs
    assert np.abs(error).mean() < bound


def test_diagonals_do_not_cut_corners():
    """A diagonal that would leave its two triangles is no path."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1.5, 0.2, 0], [1.5, -0.2, 0]])
    topology = surface_topology(vertices, np.array([[0, 1, 2], [1, 0, 3]]))
    paths = surface_paths(vertices, topology)
    distance, _ = paths.nearest(np.array([2]))
    around = 2 * np.hypot(0.5, 0.2)
    assert distance[3, 0] == pytest.approx(around)


def test_diagonals_fold_flat():
    vertices = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0.5, 0], [0, 0.5, 1]])
    topology = surface_topology(vertices, np.array([[0, 1, 2], [1, 0, 3]]))
    distance, _ = surface_paths(vertices, topology).nearest(np.array([2]))
    assert distance[3, 0] == pytest.approx(2)


def test_farthest_picks_the_farthest():
    _, paths = ball(shake=0.01)
    usable = np.ones(len(paths.start) - 1, bool)
    picked = paths.farthest(np.array([3, 9]), 20, usable)
    assert len(set(picked)) == 20
    for count in range(2, 20):
        reach = oracle(paths, picked[:count]).min(0)
        assert reach[picked[count]] == pytest.approx(reach.max(), rel=1e-12)


def test_farthest_takes_only_usable_places_until_none_is_left():
    _, paths = ball(1)
    usable = np.arange(42) % 3 == 0
    picked = paths.farthest(np.array([0]), 50, usable)
    assert sorted(picked) == np.flatnonzero(usable).tolist()


def test_paths_and_places_that_do_not_fit_are_refused():
    """Compiled loops read beyond the end of arrays, or never ended."""
    start, neighbor, length = np.array([0, 1, 3, 4]), np.array([1, 0, 2, 1]), np.ones(4)
    for given, message in (
        ((start, neighbor + 9, length), "neighbor names places"),
        ((start, neighbor, length[:1]), "length has shape"),
        ((start + 9, neighbor, length), "start does not ascend"),
        ((start, neighbor, -length), "length is -1"),
    ):
        with pytest.raises(InputError, match=message):
            SurfacePaths(*given)
    paths, usable = SurfacePaths(start, neighbor, length), np.ones(3, bool)
    with pytest.raises(InputError, match="sources names places 3"):
        paths.nearest(np.array([3]))
    with pytest.raises(InputError, match="seeds names places -4"):
        paths.farthest(np.array([-4]), 2, usable)
    with pytest.raises(InputError, match="usable has shape"):
        paths.farthest(np.array([0]), 2, usable[:1])
    for seeds in ([], [0, 1, 2]):
        with pytest.raises(InputError, match="seeds of 2 places"):
            paths.farthest(np.array(seeds, int), 2, usable)
