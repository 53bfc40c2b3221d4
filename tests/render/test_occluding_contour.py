"""Contours of meshes: exact places, outward normals, and only what can be seen."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.render.label_map import LabelMap, rasterize, surrounding
from perfcap.render.occluding_contour import MeshEdges, ModelContour, occluding_contour

SIZE = (160, 200)
FOCAL = 200.0
CENTRE = np.array([100.0, 80.0])
Floats = NDArray[np.float64]


def look(
    vertices: Floats, faces: NDArray[np.int64], weld: NDArray[np.int64] | None = None, **settings
) -> tuple[ModelContour, LabelMap]:
    """Contour of a mesh in camera axes (y down), and its label map."""
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = FOCAL * vertices[:, :2] / vertices[:, 2:] + CENTRE
    depth = vertices[:, 2].copy()
    labels = rasterize(
        torch.from_numpy(pixels), torch.from_numpy(depth), torch.as_tensor(faces.copy()), SIZE
    )
    return occluding_contour(
        pixels, depth, MeshEdges.build(faces, weld), labels, **settings
    ), labels


def sphere(x: float = 0.0, y: float = 0.0, z: float = 4.0, radius: float = 1.0, fine: int = 3):
    mesh = trimesh.creation.icosphere(subdivisions=fine, radius=radius)
    # camera axes are a rotation of y-up axes, which keeps triangles counter-clockwise outside
    turned = mesh.vertices @ np.diag([1.0, -1.0, -1.0])
    return turned + np.array([x, y, z]), np.array(mesh.faces)


def box(centre: tuple[float, float, float], extents: tuple[float, float, float]):
    mesh = trimesh.creation.box(extents=extents)
    return mesh.vertices @ np.diag([1.0, -1.0, -1.0]) + np.array(centre), np.array(mesh.faces)


def both(first, second):
    """Two meshes as one."""
    vertices = np.concatenate([first[0], second[0]])
    return vertices, np.concatenate([first[1], second[1] + len(first[0])])


def test_sphere_has_its_outline() -> None:
    contour, _ = look(*sphere(fine=4))
    radius = FOCAL / np.sqrt(4.0**2 - 1)  # of the image of a sphere on the axis
    ray = contour.points - CENTRE
    distance = np.linalg.norm(ray, axis=1)
    assert contour.outer.all()
    assert np.abs(distance - radius).max() < 0.3  # of a polyhedron
    assert ((contour.normals * ray).sum(1) / distance).min() > np.cos(np.radians(12))
    np.testing.assert_allclose(np.linalg.norm(contour.normals, axis=1), 1)
    turn = np.sort(np.arctan2(ray[:, 1], ray[:, 0]))
    assert np.diff(turn).max() * radius < 8  # all the way round
    assert len(contour) == pytest.approx(2 * np.pi * radius / 3, rel=0.1)


def test_points_are_where_their_vertices_put_them() -> None:
    vertices, faces = sphere(x=0.6, y=-0.3, z=2.5)
    contour, _ = look(vertices, faces, spacing=1.0)
    np.testing.assert_allclose(contour.weights.sum(1), 1)
    assert contour.weights.min() >= 0
    points = np.einsum("pk,pkx->px", contour.weights, vertices[contour.vertices])
    projected = FOCAL * points[:, :2] / points[:, 2:] + CENTRE
    np.testing.assert_allclose(projected, contour.points, atol=1e-9)


def test_box_has_exact_edges_and_normals() -> None:
    contour, _ = look(*box((0.1, 0.05, 4.5), (1.0, 1.2, 1.0)))  # the nearest face hides the rest
    left, right = FOCAL * (0.1 - 0.5) / 4 + 100, FOCAL * (0.1 + 0.5) / 4 + 100
    on_left = np.isclose(contour.points[:, 0], left, atol=1e-9)
    on_right = np.isclose(contour.points[:, 0], right, atol=1e-9)
    assert on_left.sum() > 15
    assert on_right.sum() > 15
    middle = np.abs(contour.points[:, 1] - CENTRE[1]) < 10
    assert (contour.normals[on_left & middle][:, 0] < -0.7).all()  # corners bend the ends
    assert (contour.normals[on_right & middle][:, 0] > 0.7).all()


def test_limb_before_torso_is_an_inner_contour() -> None:
    torso, arm = box((0.0, 0.0, 4.0), (1.6, 1.6, 0.2)), box((0.2, 0.0, 3.5), (0.3, 0.6, 0.1))
    contour, labels = look(*both(torso, arm))
    on_arm = contour.vertices[:, 0] >= 8
    assert on_arm.sum() > 20
    assert not contour.outer[on_arm].any()
    assert contour.outer[~on_arm].all()
    arm_depth = labels.depth.numpy()[80, 113]
    assert arm_depth < 3.5


def test_limb_behind_torso_has_no_contour() -> None:
    torso, arm = box((0.0, 0.0, 4.0), (1.6, 1.6, 0.2)), box((0.2, 0.0, 4.6), (0.3, 0.6, 0.1))
    contour, _ = look(*both(torso, arm))
    assert (contour.vertices < 8).all()


def test_limb_that_sticks_out_is_outer_there_and_inner_elsewhere() -> None:
    torso, arm = box((0.0, 0.0, 4.0), (1.0, 1.0, 0.2)), box((0.6, 0.0, 3.6), (0.8, 0.2, 0.1))
    contour, _ = look(*both(torso, arm))
    on_arm = contour.vertices[:, 0] >= 8
    beyond = contour.points[:, 0] > FOCAL * 0.5 / 3.9 + CENTRE[0]
    assert contour.outer[on_arm & beyond].all()
    assert not contour.outer[on_arm & ~beyond].any()
    assert (on_arm & ~beyond).any()
    # the torso's right edge is hidden behind the arm
    hidden = ~on_arm & (np.abs(contour.points[:, 1] - CENTRE[1]) < 4) & (contour.points[:, 0] > 110)
    assert not hidden.any()


@pytest.mark.parametrize(("distance", "seen"), [(0.02, False), (0.1, True)])
def test_surface_close_behind_makes_no_contour(distance: float, seen: bool) -> None:
    torso = box((0.0, 0.0, 4.0), (1.6, 1.6, 0.2))
    arm = box((0.0, 0.0, 3.9 - distance / 2), (0.4, 0.4, distance))
    contour, _ = look(*both(torso, arm))
    assert (contour.vertices >= 8).any() == seen


def test_seams_make_no_contour() -> None:
    vertices, faces = sphere()
    split, own = vertices[faces.reshape(-1)], np.arange(faces.size).reshape(-1, 3)
    welded, _ = look(split, own, faces.reshape(-1))
    plain, _ = look(vertices, faces)
    assert len(welded) == len(plain)
    apart = np.linalg.norm(welded.points[:, None] - plain.points[None], axis=-1)
    assert apart.min(0).max() < 3
    assert apart.min(1).max() < 3
    # torn apart, the sphere has borders everywhere but nothing far behind them
    torn, _ = look(split, own)
    assert np.linalg.norm(torn.points - CENTRE, axis=1).min() > 30


def test_open_border_is_a_contour_from_both_sides() -> None:
    corners = np.array([[-0.5, -0.5, 3], [0.5, -0.5, 3], [0.5, 0.5, 3], [-0.5, 0.5, 3]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    for order in (faces, faces[:, ::-1]):
        contour, _ = look(corners.astype(float), order.copy())
        assert len(contour) == pytest.approx(4 * FOCAL / 3 / 3, abs=2)
        assert contour.outer.all()
        ray = contour.points - CENTRE
        assert ((contour.normals * ray).sum(1) > 0).all()


def test_image_border_makes_no_contour() -> None:
    contour, _ = look(*sphere(x=-1.8, fine=4))
    assert len(contour) > 20
    assert contour.points[:, 0].min() >= -0.5
    assert (np.linalg.norm(contour.points - CENTRE - [-90, 0], axis=1) > 40).all()


def test_mesh_that_cannot_be_seen_has_no_contour() -> None:
    for case in (sphere(z=-4.0), sphere(x=50.0), sphere(z=0.0, radius=0.01)):
        contour, _ = look(*case)
        assert len(contour) == 0
        assert contour.points.shape == (0, 2)
    vertices, faces = sphere()
    vertices[::2] = np.nan
    assert np.isfinite(look(vertices, faces)[0].points).all()
    assert len(look(vertices, np.zeros((0, 3), np.int64))[0]) == 0


def test_vertex_behind_the_camera_leaves_the_rest() -> None:
    vertices, faces = both(sphere(fine=2), sphere(x=0.2, z=0.0, radius=0.5, fine=2))
    contour, _ = look(vertices, faces)
    assert np.isfinite(contour.points).all()
    assert (contour.vertices < len(sphere(fine=2)[0])).all()


def test_spacing_sets_the_number_of_points_and_not_their_spread() -> None:
    dense, _ = look(*sphere(), spacing=0.5)
    sparse, _ = look(*sphere(), spacing=4.0)
    assert len(dense) / len(sparse) == pytest.approx(8, rel=0.15)
    for contour in (dense, sparse):
        assert np.abs(contour.points.mean(0) - CENTRE).max() < 2.5


def test_bad_input() -> None:
    vertices, faces = sphere(fine=1)
    pixels, depth = vertices[:, :2], vertices[:, 2]
    mesh = MeshEdges.build(faces)
    labels = LabelMap(torch.full((4, 4), torch.inf), torch.full((4, 4), -1, dtype=torch.int32))
    with pytest.raises(InputError, match="pixels has shape"):
        occluding_contour(pixels[:-1], depth, mesh, labels)
    with pytest.raises(InputError, match="for the mesh's 42 vertices"):
        occluding_contour(pixels[:-1], depth[:-1], mesh, labels)
    with pytest.raises(InputError, match="spacing is 0"):
        occluding_contour(pixels, depth, mesh, labels, spacing=0)
    batched = LabelMap(labels.depth[None], labels.triangle[None])
    with pytest.raises(InputError, match="expected one frame"):
        occluding_contour(pixels, depth, mesh, batched)


@pytest.mark.parametrize("place", [(0.2, -0.1, 4.0), (1.9, 0.3, 4.0), (0.0, 1.5, 3.0)])
def test_a_map_of_the_part_that_holds_the_mesh_is_as_good(place: tuple[float, ...]) -> None:
    vertices, faces = sphere(*place)
    whole, _ = look(vertices, faces, spacing=1.0)
    pixels, depth = FOCAL * vertices[:, :2] / vertices[:, 2:] + CENTRE, vertices[:, 2].copy()
    drawn = torch.from_numpy(pixels), torch.from_numpy(depth)
    part = surrounding(*drawn, SIZE, 3)
    assert part != (slice(0, SIZE[0]), slice(0, SIZE[1]))
    labels = rasterize(*drawn, torch.as_tensor(faces.copy()), SIZE, part=part)
    found = occluding_contour(pixels, depth, MeshEdges.build(faces), labels, 1.0)
    assert len(whole) > 50
    for name in ("points", "normals", "vertices", "weights", "outer"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
