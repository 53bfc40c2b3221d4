"""Hard z-buffer: exact coverage, exact depth, bad triangles, and the two implementations agree."""

from __future__ import annotations

import math

import pytest
import torch
import trimesh
from torch import Tensor

from perfcap.render import _zbuffer_reference as reference
from perfcap.render.label_map import (
    BITS,
    Cull,
    LabelMap,
    barycentric_at,
    cover,
    rasterize,
    snap,
    surrounding,
    usable_vertices,
)

SIZE = (48, 64)


def rasterize_reference(
    pixels: Tensor, depth: Tensor, faces: Tensor, size: tuple[int, int], cull: Cull
) -> LabelMap:
    surface = torch.full(size, torch.inf, dtype=torch.float64)
    triangle = torch.full(size, -1, dtype=torch.int32)
    reference.fill(*snap(pixels, depth), faces.long(), cull.value, BITS, surface, triangle)
    return LabelMap(surface.to(depth.dtype), triangle)


def sphere(subdivisions: int = 3, distance: float = 4.0, focal: float = 90.0):
    """A unit sphere on the optical axis: pixels, depth, faces."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    points = torch.tensor(mesh.vertices.copy()) + torch.tensor([0.0, 0.0, distance])
    return project(points, focal), points[:, 2], torch.tensor(mesh.faces.copy())


def project(points: Tensor, focal: float = 90.0) -> Tensor:
    centre = torch.tensor([SIZE[1] / 2, SIZE[0] / 2], dtype=points.dtype)
    return focal * points[..., :2] / points[..., 2:] + centre


def soup(seed: int, triangles: int = 60, dtype: torch.dtype = torch.float64):
    """Random triangles, some outside the image, behind the camera or tiny."""
    rng = torch.Generator().manual_seed(seed)
    middle = torch.rand(triangles, 1, 2, generator=rng, dtype=dtype) * 90 - 15
    extent = 60 * torch.rand(triangles, 1, 1, generator=rng, dtype=dtype) ** 3
    pixels = middle + extent * torch.randn(triangles, 3, 2, generator=rng, dtype=dtype)
    depth = 3 * torch.rand(triangles * 3, generator=rng, dtype=dtype) - 0.05
    return pixels.view(-1, 2), depth, torch.arange(3 * triangles).view(-1, 3)


def square_grid(cells: int, jitter: float, seed: int = 0):
    """A triangulated square of random inner vertices, edges often through pixel centres."""
    rng = torch.Generator().manual_seed(seed)
    line = torch.linspace(5, 40, cells + 1, dtype=torch.float64)
    points = torch.cartesian_prod(line, line).view(cells + 1, cells + 1, 2)
    inner = torch.rand(cells - 1, cells - 1, 2, generator=rng, dtype=torch.float64) - 0.5
    points[1:-1, 1:-1] += jitter * inner
    index = torch.arange((cells + 1) ** 2).view(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = torch.cat([torch.stack([a, b, c], -1), torch.stack([a, c, d], -1)])
    return points.view(-1, 2), faces.view(-1, 3)


@pytest.mark.parametrize("cull", list(Cull))
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("seed", range(3))
def test_twins_agree_on_open_meshes(seed: int, dtype: torch.dtype, cull: Cull) -> None:
    mesh = soup(seed, dtype=dtype)
    fast, plain = rasterize(*mesh, SIZE, cull), rasterize_reference(*mesh, SIZE, cull)
    assert fast.mask.sum() > 100
    assert torch.equal(fast.triangle, plain.triangle)
    torch.testing.assert_close(fast.depth, plain.depth, rtol=0, atol=1e-9)


@pytest.mark.parametrize("cull", list(Cull))
def test_twins_agree_on_a_closed_mesh_in_chunks(
    cull: Cull, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reference, "CANDIDATES", 100)
    mesh = sphere()
    fast, plain = rasterize(*mesh, SIZE, cull), rasterize_reference(*mesh, SIZE, cull)
    assert torch.equal(fast.triangle, plain.triangle)
    assert torch.equal(fast.depth, plain.depth)


def test_culling_keeps_the_near_or_the_far_side() -> None:
    mesh = sphere()
    every, near, far = (rasterize(*mesh, SIZE, cull) for cull in Cull)
    assert torch.equal(every.triangle, near.triangle)
    assert torch.equal(every.mask, far.mask)
    assert (near.depth[near.mask] <= far.depth[far.mask]).all()
    assert near.depth[24, 32] == pytest.approx(3, abs=5e-3)
    assert far.depth[24, 32] == pytest.approx(5, abs=5e-3)


@pytest.mark.parametrize("jitter", [0.0, 3.0])
@pytest.mark.parametrize("cells", [1, 5, 7])
def test_shared_edges_have_no_cracks_and_no_double_hits(cells: int, jitter: float) -> None:
    pixels, faces = square_grid(cells, jitter)
    depth = torch.ones(len(pixels), dtype=torch.float64)
    hits = torch.zeros(SIZE, dtype=torch.int64)
    for face in faces:
        hits += rasterize(pixels, depth, face[None], SIZE).mask
    expected = torch.zeros_like(hits)
    expected[5:40, 5:40] = 1  # the top and left borders belong to the square, the others do not
    assert torch.equal(hits, expected)


def test_coverage_does_not_depend_on_winding() -> None:
    pixels, depth, faces = soup(4)
    flipped = rasterize(pixels, depth, faces.flip(-1), SIZE)
    assert torch.equal(rasterize(pixels, depth, faces, SIZE).triangle, flipped.triangle)


def test_area_of_a_sphere() -> None:
    pixels, depth, faces = sphere(subdivisions=4)
    radius = 90 / math.sqrt(4.0**2 - 1)  # the outline is seen under the angle asin(1 / 4)
    area = rasterize(pixels, depth, faces, SIZE).mask.sum().item()
    assert area == pytest.approx(math.pi * radius**2, rel=0.01)


def test_depth_of_a_slanted_plane_is_perspective_correct() -> None:
    corners = torch.tensor([[-2, -2], [2, -2], [2, 2], [-2, 2]], dtype=torch.float64)
    normal = torch.tensor([0.5, -0.2, 1.0], dtype=torch.float64)  # normal . X = 3
    points = torch.cat([corners, (3 - corners @ normal[:2])[:, None]], -1)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    seen = rasterize(project(points), points[:, 2], faces, SIZE)
    row, column = torch.meshgrid(*(torch.arange(n).double() for n in SIZE), indexing="ij")
    rays = torch.stack([(column - 32) / 90, (row - 24) / 90, torch.ones_like(row)], -1)
    exact = 3 / (rays @ normal)
    assert seen.mask.all()
    torch.testing.assert_close(seen.depth, exact, rtol=0, atol=1e-5)


def test_barycentric_weights_reproduce_the_surface() -> None:
    pixels, depth, faces = sphere()
    seen = rasterize(pixels, depth, faces, SIZE)
    weights = seen.barycentric(pixels, depth, faces)
    corners = faces[seen.triangle[seen.mask].long()]
    assert torch.equal(weights[~seen.mask], torch.zeros_like(weights[~seen.mask]))
    torch.testing.assert_close(weights.sum(-1), seen.mask.double())
    blended = (weights[seen.mask] * depth[corners]).sum(-1)
    torch.testing.assert_close(blended, seen.depth[seen.mask], rtol=0, atol=1e-3)
    points = torch.cat([pixels * depth[:, None], depth[:, None]], -1)  # projects by division
    back = (weights[seen.mask][..., None] * points[corners]).sum(-2)
    row, column = torch.nonzero(seen.mask, as_tuple=True)
    found = back[:, :2] / back[:, 2:]
    torch.testing.assert_close(found, torch.stack([column, row], -1).double(), rtol=0, atol=1e-3)


def test_barycentric_is_differentiable() -> None:
    points = torch.tensor([[1.2, 1.4]], dtype=torch.float64)
    corners = torch.tensor([[[0.0, 0], [4, 0.5], [1, 5]]], dtype=torch.float64, requires_grad=True)
    depth = torch.tensor([[1.0, 2, 3]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda c, d: barycentric_at(points, c, d), (corners, depth))


def test_barycentric_of_a_flat_triangle_is_finite() -> None:
    corners = torch.zeros(1, 3, 2, dtype=torch.float64)
    weights = barycentric_at(torch.zeros(1, 2).double(), corners, torch.ones(1, 3).double())
    torch.testing.assert_close(weights, torch.full_like(weights, 1 / 3))


def test_batch_equals_loop() -> None:
    frames = [soup(seed) for seed in range(6)]
    pixels = torch.stack([frame[0] for frame in frames]).view(2, 3, -1, 2)
    depth = torch.stack([frame[1] for frame in frames]).view(2, 3, -1)
    faces = frames[0][2]
    together = rasterize(pixels, depth, faces, SIZE)
    weights = together.barycentric(pixels, depth, faces)
    for i, j in ((0, 0), (0, 2), (1, 1)):
        alone = rasterize(pixels[i, j], depth[i, j], faces, SIZE)
        assert torch.equal(together.triangle[i, j], alone.triangle)
        assert torch.equal(together.depth[i, j], alone.depth)
        assert torch.equal(weights[i, j], alone.barycentric(pixels[i, j], depth[i, j], faces))


def test_labels_follow_faces() -> None:
    pixels, depth, faces = sphere()
    labels = (depth[faces].mean(-1) < 3.3).to(torch.uint8) + 1
    drawn = rasterize(pixels, depth, faces, SIZE).label(labels)
    assert drawn.dtype == torch.uint8
    assert drawn[24, 32] == 2
    assert drawn[0, 0] == 0
    assert set(drawn.unique().tolist()) == {0, 1, 2}


def test_triangles_partly_outside_are_cut_at_the_border() -> None:
    pixels = torch.tensor([[-1e5, -1e5], [1e5, -1e5], [0.0, 1e5]], dtype=torch.float64)
    seen = rasterize(pixels, torch.full((3,), 2.0).double(), torch.tensor([[0, 1, 2]]), SIZE)
    assert seen.mask.all()
    torch.testing.assert_close(seen.depth, torch.full_like(seen.depth, 2))
    outside = rasterize(pixels - 3e4, torch.ones(3).double(), torch.tensor([[0, 1, 2]]), (4, 4))
    assert outside.mask.sum() in (0, 16)


@pytest.mark.parametrize("spoil", [float("nan"), float("inf"), -float("inf"), 1e30])
def test_unusable_vertices_take_only_their_triangles_along(spoil: float) -> None:
    pixels, depth, faces = sphere()
    away = [bool((face == 7).any()) for face in faces]
    kept = faces[~torch.tensor(away)]
    expected = rasterize(pixels, depth, kept, SIZE)
    in_pixels, in_depth = pixels.clone(), depth.clone()
    in_pixels[7, 1] = spoil
    if spoil != 1e30:
        in_depth[7] = spoil
    assert torch.equal(rasterize(in_pixels, depth, faces, SIZE).depth, expected.depth)
    assert torch.equal(rasterize(pixels, in_depth, faces, SIZE).mask, expected.mask) or (
        spoil == 1e30
    )


@pytest.mark.parametrize("depth", [0.049, 0.0, -2.0])
def test_triangles_at_or_behind_the_camera_are_dropped(depth: float) -> None:
    pixels = torch.tensor([[5.0, 5], [30, 5], [5, 30]])
    depths = torch.tensor([2.0, 2.0, depth])
    assert not rasterize(pixels, depths, torch.tensor([[0, 1, 2]]), SIZE).mask.any()


def test_degenerate_triangles_and_empty_meshes_draw_nothing() -> None:
    line = torch.tensor([[5.0, 5], [10, 10], [20, 20]])
    depth = torch.ones(3)
    collapsed = torch.tensor([[0, 1, 2], [0, 0, 1], [2, 2, 2]])
    assert not rasterize(line, depth, collapsed, SIZE).mask.any()
    no_faces = torch.zeros(0, 3, dtype=torch.int64)
    assert not rasterize(line, depth, no_faces, SIZE).mask.any()
    empty = rasterize(line[:0], depth[:0], no_faces, SIZE)
    assert torch.isinf(empty.depth).all()
    assert not empty.barycentric(line[:0], depth[:0], no_faces).any()
    assert not rasterize_reference(line, depth, collapsed, SIZE, Cull.NONE).mask.any()


def test_equal_depths_go_to_the_lower_index() -> None:
    pixels = torch.tensor([[5.0, 5], [30, 5], [5, 30]])
    faces = torch.tensor([[0, 1, 2], [2, 1, 0], [0, 1, 2]])
    assert rasterize(pixels, torch.ones(3), faces, SIZE).triangle.max() == 0


def test_inputs_with_gradients_are_drawn_and_left_alone() -> None:
    pixels, depth, faces = sphere()
    before = pixels.clone()
    seen = rasterize(pixels.requires_grad_(), depth.requires_grad_(), faces, SIZE)
    assert not seen.depth.requires_grad
    assert torch.equal(pixels, before)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("seed", range(3))
def test_a_part_of_an_image_has_the_same_bits(seed: int, dtype: torch.dtype) -> None:
    mesh, part = soup(seed, dtype=dtype), (slice(7, 40), slice(11, 60))
    whole, found = rasterize(*mesh, SIZE), rasterize(*mesh, SIZE, part=part)
    assert found.mask.sum() > 100
    assert found.corner == (7, 11)
    assert torch.equal(found.triangle, whole.triangle[part])
    assert torch.equal(found.depth, whole.depth[part])
    weights = found.barycentric(*mesh), whole.barycentric(*mesh)[part]
    assert torch.equal(*weights)


@pytest.mark.parametrize("seed", range(6))
def test_what_surrounds_a_mesh_holds_all_of_it(seed: int) -> None:
    pixels, depth, faces = soup(seed, triangles=1 + seed // 2)
    pixels = 0.3 * pixels + torch.tensor([30.0 * (seed - 2), 10.0])  # some are outside
    rows, columns = surrounding(pixels, depth, SIZE, 2)
    whole = rasterize(pixels, depth, faces, SIZE).mask
    inside = torch.zeros_like(whole)
    inside[rows, columns] = True
    assert not (whole & ~inside).any()
    if whole.any() and not inside.all():
        drawn = torch.nonzero(whole)
        room = torch.stack((drawn.amin(0), drawn.amax(0)))
        tight = torch.tensor([[rows.start, columns.start], [rows.stop - 1, columns.stop - 1]])
        border = torch.tensor([[0, 0], [SIZE[0] - 1, SIZE[1] - 1]])
        assert (((room - tight).abs() >= 2) | (tight == border)).all()


def test_a_mesh_outside_the_image_is_surrounded_by_a_pixel() -> None:
    far, depth = torch.tensor([[-90.0, 200.0], [-80.0, 210.0], [-95.0, 220.0]]), torch.ones(3)
    none = torch.full_like(far, torch.nan)
    for pixels in (far, none, -far):
        part = surrounding(pixels, depth, SIZE, 2)
        drawn = rasterize(pixels, depth, torch.tensor([[0, 1, 2]]), SIZE, part=part)
        assert drawn.mask.shape == (1, 1) and not drawn.mask.any()


@pytest.mark.parametrize("seed", range(4))
def test_what_is_covered_is_what_is_drawn(seed: int) -> None:
    pixels, depth, faces = soup(seed)
    for part in (None, (slice(5, 31), slice(20, 60))):
        drawn = rasterize(pixels, depth, faces, SIZE, part=part)
        assert torch.equal(cover(pixels, depth, faces, SIZE, part), drawn.mask)


def test_twins_put_vertices_onto_the_same_grid() -> None:
    pixels, depth, _ = soup(3)
    pixels[5, 0], pixels[6, 1], depth[7], depth[8] = torch.nan, torch.inf, -1.0, torch.nan
    grid, inverse, usable = snap(pixels[None], depth[None])
    assert torch.equal(usable[0], usable_vertices(pixels, depth))
    assert 0 < int(usable.sum()) < len(depth) - 3
    expected = reference.snap(pixels, depth, usable[0], BITS)
    assert torch.equal(grid[0], expected[0])
    assert torch.equal(inverse[0], expected[1])
