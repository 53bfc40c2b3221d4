"""The Laplacian and its solves on good and bad triangles."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from perfcap.geometry.laplacian import laplacian
from perfcap.rigging.bone_heat import conduct, smooth


def sphere(subdivisions: int = 3) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces)


def test_spherical_harmonics_are_eigenfunctions() -> None:
    vertices, faces = sphere()
    matrix, area = laplacian(vertices, faces)
    assert area.sum() == pytest.approx(4 * np.pi, rel=0.02)
    side = np.abs(vertices[:, 0]) > 0.1
    ratio = (matrix @ vertices[:, 0])[side] / (area * vertices[:, 0])[side]
    assert np.median(ratio) == pytest.approx(2.0, rel=0.03)  # l (l + 1) for l = 1


def test_rows_sum_to_zero_and_nothing_is_pumped_uphill() -> None:
    random = np.random.default_rng(0)
    vertices, faces = sphere(2)
    matrix, area = laplacian(vertices * random.uniform(0.2, 1.0, (len(vertices), 3)), faces)
    dense = matrix.toarray()
    assert np.allclose(dense.sum(1), 0, atol=1e-12)
    assert np.allclose(dense, dense.T)
    assert (dense - np.diag(np.diag(dense)) <= 0).all()
    assert (area > 0).all()


def test_degenerate_and_non_manifold_triangles_stay_finite() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0], [1, -1, 0], [1, 0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 5]])  # a needle; a fin of three
    matrix, area = laplacian(vertices, faces)
    assert np.isfinite(matrix.toarray()).all() and np.isfinite(area).all()


def test_equilibrium_lies_between_its_sources() -> None:
    vertices, faces = sphere()
    matrix, area = laplacian(vertices, faces)
    north, south = vertices[:, 2] > 0.9, vertices[:, 2] < -0.9
    sources = np.stack((north, south), 1).astype(float)
    heat = 50.0 * (north | south)
    values = conduct(matrix, area, heat, sources, np.ones(len(vertices), bool))
    assert values.min() >= 0 and values.max() <= 1
    assert np.allclose(values.sum(1), 1)
    assert (np.diff(values[np.argsort(vertices[:, 2]), 0][::40]) > -1e-3).all()


def test_smoothing_keeps_sums_and_what_lies_outside() -> None:
    vertices, faces = sphere()
    matrix, area = laplacian(vertices, faces)
    values = np.stack((vertices[:, 2] > 0, vertices[:, 2] <= 0), 1).astype(float)
    reach = np.where(vertices[:, 0] > 0, 0.2, 0.0)
    blurred = smooth(matrix, area, values, reach)
    assert np.allclose(blurred.sum(1), 1)
    assert blurred.min() >= -1e-12
    far = vertices[:, 0] <= 0
    assert np.allclose(blurred[far], values[far])
    assert np.allclose(area @ blurred, area @ values)  # heat is moved, not lost


def test_nothing_flows_to_what_is_left_out() -> None:
    """Heat of one temperature stays where it is, whichever places are left out."""
    vertices, faces = sphere()
    matrix, area = laplacian(vertices, faces)
    free = vertices[:, 0] > -0.3
    heat = np.exp(4 * vertices[:, 2])
    found = conduct(matrix, area, heat, np.full((len(vertices), 1), 0.7), free)
    assert found.shape == (free.sum(), 1) and np.allclose(found, 0.7, atol=1e-9)
