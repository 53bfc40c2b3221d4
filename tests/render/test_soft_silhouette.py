"""Soft silhouettes: exact away from the outline, a known profile across it, and never NaN."""

from __future__ import annotations

from dataclasses import replace

import pytest
import synthetic
import torch
import trimesh
from torch import Tensor

from perfcap.errors import InputError
from perfcap.render.label_map import rasterize
from perfcap.render.soft_silhouette import SoftSilhouette

F64 = torch.float64
SIZE = (48, 64)
SQUARE = torch.tensor([[0, 1, 2], [0, 2, 3]])


def soup(seed: int, triangles: int = 25) -> tuple[Tensor, Tensor, Tensor]:
    """Random triangles, some outside the image, behind the camera or tiny: an open mesh."""
    rng = torch.Generator().manual_seed(seed)
    middle = torch.rand(triangles, 1, 2, generator=rng, dtype=F64) * 90 - 15
    extent = 30 * torch.rand(triangles, 1, 1, generator=rng, dtype=F64) ** 3
    pixels = middle + extent * torch.randn(triangles, 3, 2, generator=rng, dtype=F64)
    depth = 3 * torch.rand(triangles * 3, generator=rng, dtype=F64) - 0.05
    return pixels.view(-1, 2), depth, torch.arange(3 * triangles).view(-1, 3)


def ball(subdivisions: int = 2, radius: float = 15.3) -> tuple[Tensor, Tensor, Tensor]:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    points = torch.tensor(mesh.vertices.copy())
    middle = torch.tensor([31.7, 23.6], dtype=F64)
    return radius * points[:, :2] + middle, 4 + points[:, 2], torch.tensor(mesh.faces.copy())


def square(left: float, top: float, side: float) -> tuple[Tensor, Tensor]:
    corners = torch.tensor([[0, 0], [0, 1], [1, 1], [1, 0]], dtype=F64)
    return side * corners + torch.tensor([left, top], dtype=F64), torch.ones(4, dtype=F64)


def joined(*parts: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """Quadrilaterals as one mesh."""
    pixels, depth = (torch.cat(each) for each in zip(*parts, strict=True))
    return pixels, depth, torch.cat([SQUARE + 4 * i for i in range(len(parts))])


def assert_fills(pixels: Tensor, depth: Tensor, faces: Tensor, band: float = 1.5) -> Tensor:
    """Compare with the z-buffer: away from the outline coverage is exactly 0 or 1."""
    coverage = SoftSilhouette(faces, SIZE, band)(pixels, depth)
    mask = rasterize(pixels, depth, faces, SIZE).mask
    assert coverage.min() >= 0
    assert coverage.max() <= 1
    sure = (coverage == 0) | (coverage == 1)
    assert torch.equal(coverage[sure] > 0, mask[sure])
    # vertices of the z-buffer are snapped to a grid
    assert torch.equal(coverage[~sure] > 0.501, mask[~sure] & (coverage[~sure] > 0.501))
    assert torch.equal(coverage[~sure] > 0.499, mask[~sure] | (coverage[~sure] > 0.499))
    return coverage


@pytest.mark.parametrize("seed", range(6))
def test_open_meshes_fill_like_triangles(seed: int) -> None:
    pixels, depth, faces = soup(seed)
    coverage = assert_fills(pixels, depth, faces)
    assert 100 < coverage.sum() < coverage.numel() - 100


@pytest.mark.parametrize("subdivisions", [0, 3])
def test_closed_meshes_fill_like_triangles(subdivisions: int) -> None:
    pixels, depth, faces = ball(subdivisions)
    coverage = assert_fills(pixels, depth, faces)
    # the profile is odd about the outline, so that the area is unbiased up to its curvature
    rim = torch.tensor(trimesh.convex.hull_points(pixels.numpy()))
    area = 0.5 * (rim[:, 0] * rim[:, 1].roll(-1) - rim[:, 1] * rim[:, 0].roll(-1)).sum().abs()
    assert coverage.sum() == pytest.approx(float(area), rel=3e-3)


def test_profile_across_a_straight_edge() -> None:
    pixels, depth = square(10.25, -500, 2000)
    coverage = SoftSilhouette(SQUARE, SIZE, band=3.0)(pixels, depth)
    level = (0.5 + (torch.arange(64, dtype=F64) - 10.25) / 6).clamp(0, 1)
    expected = (level.square() * (3 - 2 * level)).expand(SIZE)
    torch.testing.assert_close(coverage, expected, rtol=0, atol=1e-12)
    assert coverage[0, 7] == 0  # exactly, 3.25 px outside
    assert coverage[0, 14] == 1


def test_gradient_goes_to_the_two_ends_of_the_nearest_edge() -> None:
    pixels, depth = square(10.25, 10.0, 20.0)
    pixels.requires_grad_()
    coverage = SoftSilhouette(SQUARE, SIZE, band=3.0)(pixels, depth)
    (gradient,) = torch.autograd.grad(coverage[15, 10], pixels)
    level = 0.5 - 0.25 / 6
    rate = level * (1 - level)  # 6 s (1 - s) over twice the band
    expected = torch.zeros(4, 2, dtype=F64)
    expected[0, 0], expected[1, 0] = -0.75 * rate, -0.25 * rate
    torch.testing.assert_close(gradient, expected, rtol=0, atol=1e-12)


def test_surface_within_the_silhouette_changes_nothing() -> None:
    alone = square(8.3, 8.1, 30)
    both = joined(alone, square(15.2, 14.7, 12))
    inner = both[0].requires_grad_()
    coverage = SoftSilhouette(both[2], SIZE)(inner, both[1])
    torch.testing.assert_close(coverage, SoftSilhouette(SQUARE, SIZE)(*alone), rtol=0, atol=1e-14)
    (gradient,) = torch.autograd.grad(coverage.square().sum(), inner)
    assert (gradient[:4].abs().sum(-1) > 0).all()
    assert not gradient[4:].any()


def test_faces_from_either_side_and_of_any_winding() -> None:
    pixels, depth, faces = ball()
    plain = SoftSilhouette(faces, SIZE)(pixels, depth)
    turned = faces.clone()
    turned[::3] = turned[::3].flip(-1)  # the inner borders no longer cancel, but stay inside
    for other in (faces.flip(-1), turned):
        torch.testing.assert_close(SoftSilhouette(other, SIZE)(pixels, depth), plain)


@pytest.mark.parametrize("offset", [0.0, 0.5, 0.3])
def test_copies_of_vertices_and_triangles(offset: float) -> None:
    """Seams, doubled triangles, sheets that touch: edges on one another are seen as one."""
    whole = square(10 + offset, 10 + offset, 20)
    expected = SoftSilhouette(SQUARE, SIZE)(*whole)
    shrink = torch.tensor([0.5, 1.0], dtype=F64)
    left = whole[0] * shrink + torch.tensor([0.5 * (10 + offset), 0.0], dtype=F64)
    halves = (left, whole[1]), (left + torch.tensor([10.0, 0.0], dtype=F64), whole[1])
    for mesh in (joined(whole, whole), joined(whole, whole, whole), joined(*halves)):
        pixels, depth, faces = mesh
        torch.testing.assert_close(SoftSilhouette(faces, SIZE)(pixels, depth), expected)
    split = torch.tensor([[0, 1, 2], [3, 5, 4]])  # the diagonal has its own vertices on each side
    pixels, depth = whole[0][[0, 1, 2, 0, 3, 2]], whole[1][[0, 1, 2, 0, 3, 2]]
    torch.testing.assert_close(SoftSilhouette(split, SIZE)(pixels, depth), expected)
    weld = torch.tensor([0, 1, 2, 0, 3, 2])
    torch.testing.assert_close(SoftSilhouette(split, SIZE, weld=weld)(pixels, depth), expected)


def test_welding_gives_every_copy_its_part_of_the_gradient() -> None:
    whole, depth = square(10.3, 9.6, 20)
    split, weld = torch.tensor([[0, 1, 2], [3, 5, 4]]), torch.tensor([0, 1, 2, 0, 3, 2])
    one = whole.clone().requires_grad_()
    many = whole[weld].requires_grad_()
    weight = torch.rand(SIZE, dtype=F64, generator=torch.Generator().manual_seed(0))
    (SoftSilhouette(SQUARE, SIZE)(one, depth) * weight).sum().backward()
    (SoftSilhouette(split, SIZE, weld=weld)(many, depth[weld]) * weight).sum().backward()
    assert one.grad is not None
    assert many.grad is not None
    torch.testing.assert_close(many.grad[0], many.grad[3])
    torch.testing.assert_close(torch.zeros(4, 2, dtype=F64).index_add(0, weld, many.grad), one.grad)


def test_three_sheets_on_one_edge() -> None:
    pixels = torch.tensor([[20.2, 5], [20.2, 40], [5, 20], [40, 18], [35.3, 30]], dtype=F64)
    faces = torch.tensor([[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    assert_fills(pixels, torch.ones(5, dtype=F64), faces)


@pytest.mark.parametrize(
    "corners",
    [
        [[-900.0, -900.0], [-900.0, 4000.0], [4000.0, -900.0]],  # covers the image
        [[100.5, -900.0], [100.5, 4000.0], [4000.0, 20.0]],  # right of it
        [[20.5, -900.0], [20.5, 4000.0], [4000.0, 20.0]],  # covers its right part
        [[-100.0, 10.0], [30.0, 10.0], [30.0, 30.0]],  # cut off at the left
        [[20.0, -60.0], [20.0, 9.0], [30.0, -60.0]],  # hangs in from above
        [[2e5, 0.0], [0.0, 0.0], [0.0, 20.0]],  # a vertex too far to be drawn
    ],
)
def test_partly_or_wholly_outside_the_image(corners: list[list[float]]) -> None:
    pixels = torch.tensor(corners, dtype=F64)
    assert_fills(pixels, torch.ones(3, dtype=F64), torch.tensor([[0, 1, 2]]))


@pytest.mark.parametrize("bad", ["nan", "inf", "behind"])
def test_vertices_that_cannot_be_drawn(bad: str) -> None:
    pixels, depth, faces = ball()
    lost = pixels[:, 0] > 38
    if bad == "behind":
        depth[lost] = -1.0
    else:
        pixels[lost] = float(bad)
    assert_fills(pixels, depth, faces)
    pixels.requires_grad_()
    SoftSilhouette(faces, SIZE)(pixels, depth).square().sum().backward()
    assert pixels.grad is not None
    assert pixels.grad.isfinite().all()
    assert pixels.grad[~lost].any()
    assert not pixels.grad[lost].any()


def test_nothing_to_draw() -> None:
    pixels, depth, faces = ball()
    for silhouette, scale in ((SoftSilhouette(faces, SIZE), torch.nan),
                              (SoftSilhouette(faces, SIZE), 0.0),
                              (SoftSilhouette(faces[:0], SIZE), 1.0),
                              (SoftSilhouette(faces[:, [0, 0, 1]], SIZE), 1.0)):  # fmt: skip
        moved = (pixels * scale).requires_grad_()
        coverage = silhouette(moved, depth)
        coverage.sum().backward()
        assert not coverage.any()
        assert moved.grad is not None
        assert not moved.grad.any()


def test_any_batch_equals_its_elements() -> None:
    pixels, depth, faces = ball()
    rng = torch.Generator().manual_seed(0)
    pixels = pixels + 4 * torch.randn(2, 3, 1, 2, generator=rng, dtype=F64)
    depth = depth.expand(2, 3, -1)
    silhouette = SoftSilhouette(faces, SIZE)
    inputs = pixels.requires_grad_()
    coverage = silhouette(inputs, depth)
    assert coverage.shape == (2, 3, *SIZE)
    weight = torch.rand(SIZE, generator=rng, dtype=F64)
    (gradient,) = torch.autograd.grad((coverage * weight).sum(), inputs)
    for index in torch.cartesian_prod(torch.arange(2), torch.arange(3)):
        here = tuple(index.tolist())
        single = pixels[here].detach().requires_grad_()
        alone = silhouette(single, depth[here])
        assert torch.equal(coverage[here], alone)
        (own,) = torch.autograd.grad((alone * weight).sum(), single)
        assert torch.equal(gradient[here], own)
    assert silhouette(pixels[:0], depth[:0]).shape == (0, 3, *SIZE)


def test_single_precision_follows_its_input() -> None:
    pixels, depth, faces = ball()
    silhouette = SoftSilhouette(faces, SIZE)
    single = pixels.float().requires_grad_()
    coverage = silhouette(single, depth.float())
    assert coverage.dtype == torch.float32
    torch.testing.assert_close(coverage.double(), silhouette(pixels, depth), rtol=0, atol=1e-5)
    coverage.sum().backward()
    assert single.grad is not None
    assert single.grad.dtype == torch.float32


def test_views_of_cameras() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=1)
    vertices = torch.tensor(mesh.vertices.copy()).expand(3, -1, 3)
    cameras = synthetic.cameras(views=2, size=40)
    silhouette = SoftSilhouette(torch.tensor(mesh.faces.copy()), (40, 40))
    position = cameras.translation.clone().requires_grad_()
    coverage = silhouette.seen_by(replace(cameras, translation=position), vertices)
    assert coverage.shape == (3, 2, 40, 40)
    coverage.sum().backward()
    assert position.grad is not None
    assert (position.grad[:, 2] < 0).all()  # a ball that is further away is smaller
    with pytest.raises(InputError, match="40, 40"):
        SoftSilhouette(silhouette.faces, (40, 50)).seen_by(cameras, vertices)


@pytest.mark.parametrize(
    ("faces", "settings", "words"),
    [
        (torch.zeros(3, 2, dtype=torch.long), {}, "faces"),
        (torch.zeros(3, 3), {}, "integers"),
        (torch.tensor([[0, 1, -2]]), {}, "from 0 on"),
        (SQUARE, {"size": (0, 5)}, "size"),
        (SQUARE, {"band": 0.0}, "band"),
        (SQUARE, {"band": float("nan")}, "band"),
        (SQUARE, {"weld": torch.zeros(4)}, "weld"),
        (SQUARE, {"weld": torch.arange(3)}, "weld"),
    ],
)
def test_bad_settings_are_named(faces: Tensor, settings: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        SoftSilhouette(faces, **({"size": SIZE} | settings))


def test_bad_input_is_named() -> None:
    silhouette = SoftSilhouette(SQUARE, SIZE)
    pixels, depth = square(1, 1, 5)
    for wrong in ((pixels[None], depth), (pixels[:3], depth[:3]), (pixels.long(), depth)):
        with pytest.raises(InputError, match="pixels"):
            silhouette(*wrong)
    with pytest.raises(InputError, match="weld"):
        SoftSilhouette(SQUARE, SIZE, weld=torch.arange(4))(pixels[[0, 1, 2, 3, 3]], depth[[0] * 5])
