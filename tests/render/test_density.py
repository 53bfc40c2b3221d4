"""Gaussians in images: against rays cast in space, against differences, compiled against torch."""

import math

import pytest
import torch
from synthetic import cameras as circle
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.render import _density_torch
from perfcap.render.density import LEAST, Splats, background, optical_depth

F64 = torch.float64
SIZE = (40, 56)


def blobs(images: int = 2, count: int = 6, seed: int = 1) -> tuple[Tensor, Tensor, Tensor]:
    """Centres, forms and thicknesses, some of them outside of the image."""
    draw = torch.Generator().manual_seed(seed)
    centre = torch.rand(images, count, 2, generator=draw, dtype=F64) * 50
    root = torch.randn(images, count, 2, 2, generator=draw, dtype=F64) * 2
    form = torch.linalg.inv(root @ root.mT + 4 * torch.eye(2, dtype=F64))
    entries = torch.stack((form[..., 0, 0], form[..., 0, 1], form[..., 1, 1]), -1)
    return centre, entries, 3 * torch.rand(images, count, generator=draw, dtype=F64)


def person_cameras(views: int = 3) -> Camera:
    return circle(views, size=200)


def test_kernels_equal_plain_torch() -> None:
    plain = [each.clone().requires_grad_() for each in blobs()]
    fast = [each.clone().requires_grad_() for each in blobs()]
    expected, drawn = _density_torch.draw(*plain, SIZE, LEAST), optical_depth(*fast, SIZE)
    for a, b in zip(drawn, expected, strict=True):
        torch.testing.assert_close(a, b, atol=1e-12, rtol=1e-10)
    draw = torch.Generator().manual_seed(2)
    pulls = [torch.randn(each.shape, generator=draw, dtype=F64) for each in expected]
    sums = [sum((p * each).sum() for p, each in zip(pulls, pair, strict=True))
            for pair in (expected, drawn)]  # fmt: skip
    pairs = zip(
        torch.autograd.grad(sums[1], fast), torch.autograd.grad(sums[0], plain), strict=True
    )
    for a, b in pairs:
        torch.testing.assert_close(a, b, atol=1e-10, rtol=1e-9)


def test_slope_is_that_of_the_background() -> None:
    centre, form, thickness = blobs(1)
    here = Splats(centre[0], form[0], thickness[0])
    _, slope = background(here, SIZE)
    step = 1e-4
    for axis in (0, 1):
        shift = torch.zeros(2, dtype=F64)
        shift[axis] = step
        # the image seen a little further right is that of Gaussians a little further left
        ahead, behind = (
            background(Splats(here.centre - sign * shift, here.form, here.thickness), SIZE)[0]
            for sign in (1, -1)
        )
        inner = (ahead - behind) / (2 * step)
        # pixels at the rim of a Gaussian are cut off on one side only
        off = (inner - slope[axis]).abs()
        assert float(off.quantile(0.98)) < 1e-6 and float(off.median()) < 1e-9


def test_background_is_that_of_rays_through_the_medium() -> None:
    cameras = person_cameras()
    points = torch.tensor([[[0.1, 1.0, 0.05], [-0.25, 1.3, 0.1]]], dtype=F64)
    deviations, densities = torch.tensor([0.08, 0.05]).double(), torch.tensor([9.0, 20.0]).double()
    splats = Splats.seen_by(cameras, points, deviations, densities)
    size = cameras.size[0]
    left, _ = background(splats, size)
    rng = torch.Generator().manual_seed(3)
    for view in range(cameras.views):
        local = cameras.to_camera(points)[0, view]
        where = splats.centre[0, view] + 12 * torch.randn(2, 2, generator=rng, dtype=F64)
        for pixel in where.round():
            x, y = (int(v) for v in pixel)
            plane = cameras.select([view]).to_plane(pixel[None, None])[0, 0]
            ray = torch.cat((plane, plane.new_ones(1)))
            along = torch.linspace(0, 12, 24001, dtype=F64)[:, None] * ray / ray.norm()
            squared = (along[:, None] - local).square().sum(-1)
            density = (densities * torch.exp(-0.5 * squared / deviations.square())).sum(-1)
            depth = torch.trapezoid(density, dx=12 / 24000)
            assert float(left[0, view, y, x]) == pytest.approx(math.exp(-float(depth)), abs=4e-3)


def test_gradient_reaches_points_widths_and_cameras() -> None:
    cameras = person_cameras(2)
    given = [
        torch.tensor([[[0.1, 1.0, 0.0], [-0.2, 1.2, 0.1]]], dtype=F64),
        torch.tensor([0.08, 0.06], dtype=F64),
        torch.tensor([8.0, 15.0], dtype=F64),
        cameras.translation.clone(),
    ]
    weight = torch.linspace(-1, 1, 200, dtype=F64)

    def total(points: Tensor, wide: Tensor, dense: Tensor, shift: Tensor) -> Tensor:
        moved = Camera(cameras.intrinsics, cameras.rotation, shift, size=cameras.size)
        left, slope = background(Splats.seen_by(moved, points, wide, dense), (200, 200))
        return (left * weight).sum() + (slope.square() * weight).sum()

    free = [each.clone().requires_grad_() for each in given]
    found = torch.autograd.grad(total(*free), free)
    draw = torch.Generator().manual_seed(4)
    for index, gradient in enumerate(found):
        way = torch.randn(given[index].shape, generator=draw, dtype=F64)
        moved = [
            total(*(g + s * 1e-5 * way if i == index else g for i, g in enumerate(given)))
            for s in (1, -1)
        ]
        slope = float(moved[0] - moved[1]) / 2e-5
        assert float((gradient * way).sum()) == pytest.approx(slope, rel=2e-3)


def test_nothing_behind_the_camera_or_outside() -> None:
    cameras = person_cameras(1)
    centre = cameras.centre[0]
    ahead = cameras.rotation[0, 2]
    points = torch.stack((centre - ahead, centre + 3 * ahead + 50))[None]
    splats = Splats.seen_by(
        cameras, points, torch.tensor([0.1, 0.1]).double(), torch.ones(2).double()
    )
    left, slope = background(splats, (60, 60))
    assert bool((left == 1).all()) and bool((slope == 0).all())


@pytest.mark.parametrize("place", [(-25.0, 20.0), (65.0, 20.0), (20.0, -25.0), (20.0, 65.0)])
def test_nothing_of_what_is_beside_the_image(place: tuple[float, float]) -> None:
    centre = torch.tensor([place], dtype=torch.float64)
    form, thickness = torch.tensor([[0.1, 0.0, 0.1]]).double(), torch.ones(1).double()
    left, slope = background(Splats(centre[None], form[None], thickness[None]), (40, 40))
    assert bool((left == 1).all()) and bool((slope == 0).all())


def test_float32_takes_the_other_way() -> None:
    centre, form, thickness = blobs()
    exact = optical_depth(centre, form, thickness, SIZE)[0]
    single = optical_depth(centre.float(), form.float(), thickness.float(), SIZE)[0]
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), exact, atol=2e-4, rtol=1e-3)


def test_shapes_that_do_not_fit_are_refused() -> None:
    centre, form, thickness = blobs()
    with pytest.raises(InputError, match="splats have centre"):
        background(Splats(centre, form, thickness[:, :-1]), SIZE)
    with pytest.raises(InputError, match="size is"):
        background(Splats(centre, form, thickness), (0, 5))


@pytest.mark.usefixtures("both_twins")
@pytest.mark.parametrize("form", [(0.0, 0, 0), (-1.0, 0, -1), (1.0, 5, 1), (torch.nan,) * 3])
@pytest.mark.parametrize("place", [(9.0, 9.0), (torch.nan, 0.0), (1e300, -torch.inf)])
def test_what_is_no_gaussian_or_nowhere_is_not_drawn(
    form: tuple[float, ...], place: tuple[float, ...]
) -> None:
    """Numbers that are none became indices, or a division by zero."""
    shapes = (torch.tensor(each, dtype=F64)[None, None] for each in (place, form))
    depth, slope = optical_depth(*shapes, torch.ones(1, 1, dtype=F64), SIZE)
    assert not depth.any() and not slope.any()


def test_a_thickness_that_is_no_number_does_not_end_in_a_traceback() -> None:
    centre, form = torch.zeros(1, 1, 2, dtype=F64), torch.tensor([[[1.0, 0, 1]]], dtype=F64)
    thickness = torch.full((1, 1), torch.nan, dtype=F64, requires_grad=True)
    depth, _ = optical_depth(centre, form, thickness, SIZE)
    depth.sum().backward()
    assert not depth.detach().any() and thickness.grad is not None


def test_optical_depth_refuses_shapes_that_do_not_fit() -> None:
    """Compiled loops read beyond the end of arrays."""
    centre, form, thickness = blobs()
    with pytest.raises(InputError, match="expected"):
        optical_depth(centre, form[:, :1], thickness, SIZE)
