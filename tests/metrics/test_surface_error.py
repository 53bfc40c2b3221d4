"""Distances between surfaces and overlap of masks."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from perfcap.errors import InputError
from perfcap.metrics import mask_overlap, surface_distance, surface_error, vertex_error
from perfcap.metrics.surface import point_triangle_distance


def sphere(rings: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere, (V, 3) and (T, 3)."""
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, rings), np.linspace(0, 2 * np.pi, rings), indexing="ij"
    )
    vertices = np.stack(
        (np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)), -1
    )
    index = np.arange(rings * rings).reshape(rings, rings)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return vertices.reshape(-1, 3), faces


def test_point_triangle_distance_by_dense_sampling() -> None:
    rng = np.random.default_rng(0)
    points, corners = rng.normal(size=(40, 3)), rng.normal(size=(40, 3, 3))
    u, v = np.meshgrid(np.linspace(0, 1, 160), np.linspace(0, 1, 160))
    inside = u + v <= 1
    u, v = u[inside][:, None, None], v[inside][:, None, None]
    a, b, c = corners.transpose(1, 0, 2)
    dense = np.linalg.norm(a + u * (b - a) + v * (c - a) - points, axis=-1).min(0)
    np.testing.assert_allclose(point_triangle_distance(points, corners), dense, atol=0.02)


def test_a_triangle_without_area_is_its_edges() -> None:
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert point_triangle_distance(np.array([1.5, 2, 0]), flat) == pytest.approx(2.0)
    point = np.zeros((3, 3))
    assert point_triangle_distance(np.array([0, 0, 3.0]), point) == pytest.approx(3.0)


def test_a_translation_is_no_error() -> None:
    vertices, faces = sphere()
    error = surface_error(
        vertices + np.array([1.0, 2, 3]), vertices, faces, np.random.default_rng(0)
    )
    assert error.vertex == pytest.approx(0, abs=1e-9)
    assert error.surface == pytest.approx(0, abs=1e-6)


def test_a_larger_sphere_is_off_by_the_difference_of_radii() -> None:
    vertices, faces = sphere(48)
    error = surface_error(1.1 * vertices, vertices, faces, np.random.default_rng(0))
    # the seam holds each of its vertices twice, which moves the mean a little
    assert error.vertex == pytest.approx(100, rel=0.01)
    assert error.surface == pytest.approx(100, rel=0.02)


def test_sliding_along_the_surface_is_no_surface_error() -> None:
    vertices, faces = sphere(48)
    turn = np.array([[np.cos(0.5), 0, np.sin(0.5)], [0, 1, 0], [-np.sin(0.5), 0, np.cos(0.5)]])
    error = surface_error(vertices @ turn.T, vertices, faces, np.random.default_rng(0))
    assert error.vertex > 200
    assert error.surface < 4


def test_a_part_is_averaged_alone() -> None:
    vertices, faces = sphere()
    top = vertices[:, 1] > 0.5
    moved = vertices + np.where(top, 0.1, 0)[:, None] * [0, 1, 0]
    rng = np.random.default_rng(0)
    assert surface_error(moved, vertices, faces, rng, top).vertex > 50
    assert surface_error(moved, vertices, faces, rng, ~top).vertex < 50


def test_mask_overlap() -> None:
    mask, truth = np.zeros((2, 8, 8), bool)
    mask[:4], truth[2:6] = True, True
    overlap = mask_overlap(mask, truth)
    assert overlap.iou == pytest.approx(1 / 3)
    assert overlap.precision == overlap.recall == pytest.approx(1 / 2)


@pytest.mark.parametrize(("found", "iou"), [(False, 1.0), (True, 0.0)])
def test_empty_truth(found: bool, iou: float) -> None:
    overlap = mask_overlap(np.full((4, 4), found), np.zeros((4, 4), bool))
    assert (overlap.iou, overlap.precision, overlap.recall) == (iou, iou, iou)


def test_surfaces_of_other_topology() -> None:
    """A coarse sphere lies within a fine one: the distance is known from their volumes' radii."""
    fine, coarse = sphere(60), sphere(20)
    rng = np.random.default_rng(0)
    assert surface_distance(*fine, *coarse, rng) < 12
    moved = surface_distance(fine[0] + [3.0, 0, 0], fine[1], *fine, rng)
    assert moved > 1000


def test_without_alignment_a_translation_is_an_error() -> None:
    vertices, faces = sphere()
    rng = np.random.default_rng(0)
    error = surface_error(vertices + np.array([0, 0.1, 0]), vertices, faces, rng, translated=False)
    assert error.vertex == pytest.approx(100)
    assert 30 < error.surface < 100


def test_refuses_another_template() -> None:
    vertices, faces = sphere()
    with pytest.raises(InputError, match="one template"):
        surface_error(vertices[:-1], vertices, faces, np.random.default_rng(0))


def test_parts_are_masks() -> None:
    """Indices were taken for a mask: those of the first vertices were measured."""
    vertices, faces = sphere()
    moved, rng = 1.1 * vertices, np.random.default_rng(0)
    for part in (np.arange(5, 9), np.ones(len(vertices), int), np.ones(5, bool)):
        with pytest.raises(InputError, match=r"^part has shape .* expected bool \(576,\)"):
            surface_error(moved, vertices, faces, rng, part)
    both = torch.tensor(np.stack((moved, vertices)))
    for numbers in (torch.arange(3), torch.ones(576, dtype=torch.uint8)):
        with pytest.raises(InputError, match=r"^part has shape"):
            vertex_error(both, both, numbers)


def test_vertices_of_no_face_are_no_surface() -> None:
    vertices, faces = sphere()
    stray = np.vstack((vertices, np.full((200, 3), 9.0), [[np.nan] * 3]))
    rng = np.random.default_rng(0)
    assert surface_distance(stray, faces, vertices, faces, rng) < 1e-6


def test_surfaces_that_are_none() -> None:
    vertices, faces = sphere()
    rng = np.random.default_rng(0)
    lost = vertices.copy()
    lost[40] = np.nan
    for bad in ((lost, faces), (vertices, faces - 1), (0 * vertices, faces), (vertices, faces[:0])):
        for pair in ((*bad, vertices, faces), (vertices, faces, *bad)):
            with pytest.raises(InputError, match=r"not all finite|names vertices|without area"):
                surface_distance(*pair, rng)
    with pytest.raises(InputError, match=r"^vertices are not all finite"):
        surface_error(lost, vertices, faces, rng)
