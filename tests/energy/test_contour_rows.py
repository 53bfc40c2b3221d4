"""The contour energy row by row: against what plain torch draws, prices and differentiates."""

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.energy import _contour_torch
from perfcap.energy._contour_rows_numba import look
from perfcap.energy._fading_numba import fading
from perfcap.render import _density_torch
from perfcap.render.density import LEAST

F64 = torch.float64
BEND = 0.25
Blobs = tuple[Tensor, Tensor, Tensor]


def blobs(size: tuple[int, int], count: int = 9, seed: int = 1, tilt: float = 0.0) -> Blobs:
    """Round and tilted Gaussians in and about an image, one of them too thin to be seen."""
    draw = torch.Generator().manual_seed(seed)
    scale = torch.tensor(size[::-1], dtype=F64)
    centre = (1.4 * torch.rand(count, 2, generator=draw, dtype=F64) - 0.2) * scale
    root = torch.randn(count, 2, 2, generator=draw, dtype=F64) * 2 + 3 * torch.eye(2, dtype=F64)
    root = root + tilt * torch.ones(2, 2, dtype=F64)
    form = torch.linalg.inv(root @ root.mT + torch.eye(2, dtype=F64))
    thickness = 3 * torch.rand(count, generator=draw, dtype=F64)
    thickness[-1] = 0.0
    return centre, torch.stack((form[:, 0, 0], form[:, 0, 1], form[:, 1, 1]), -1), thickness


def image(size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    draw = torch.Generator().manual_seed(2)
    return torch.randn(2, *size, generator=draw), torch.rand(*size, generator=draw) - 0.3


def found(splats: Blobs, field: tuple[Tensor, Tensor], derivatives: bool = True) -> list[Tensor]:
    """Value, derivatives and curvature of the kernel."""
    edges, flat = (each.numpy() for each in field)
    like = (*splats, splats[1])
    arrays = [np.full(each.shape, np.nan) for each in like]
    shapes = tuple(each.numpy() for each in splats)
    value = look(shapes, LEAST, edges, flat, BEND, derivatives, tuple(arrays[:3]), arrays[3])
    return [torch.tensor(value, dtype=F64), *(torch.from_numpy(each) for each in arrays)]


def expected(splats: Blobs, field: tuple[Tensor, Tensor]) -> list[Tensor]:
    """The same from plain torch."""
    edges, flat = (each.double() for each in field)
    size = flat.shape[0], flat.shape[1]
    free = [each.clone().requires_grad_() for each in splats]
    centre, form, thickness = (each[None] for each in free)
    depth, slope = _density_torch.draw(centre, form, thickness, size, LEAST)
    value = _contour_torch.contour(depth[0], slope[0], edges, flat).sum()
    gradients = torch.autograd.grad(value, free)
    with torch.no_grad():
        bent = _contour_torch.curvature(depth[0], slope[0], edges, flat, BEND)
        curved = _density_torch.gather(centre, form, thickness, bent[None], LEAST)[0]
    return [value.detach(), *gradients, curved]


@pytest.mark.parametrize("tilt", [0.0, 2.0, 40.0])
@pytest.mark.parametrize("size", [(40, 56), (7, 130), (90, 3)])
def test_equals_plain_torch(size: tuple[int, int], tilt: float) -> None:
    """Round Gaussians are carried from row to row, those that are much tilted are not."""
    splats, field = blobs(size, tilt=tilt), image(size)
    pairs = zip(found(splats, field), expected(splats, field), strict=True)
    for ours, theirs in pairs:
        torch.testing.assert_close(ours, theirs, rtol=1e-9, atol=1e-9 * float(theirs.abs().max()))


def test_value_alone_is_the_same() -> None:
    splats, field = blobs((40, 56)), image((40, 56))
    value, *untouched = found(splats, field, derivatives=False)
    torch.testing.assert_close(value, found(splats, field)[0], rtol=0, atol=0)
    assert all(bool(each.isnan().all()) for each in untouched)


def test_wide_gaussians_stay_exact_from_row_to_row() -> None:
    size = (400, 300)
    centre = torch.tensor([[150.3, 200.7], [20.0, -30.0]], dtype=F64)
    form = torch.tensor([[1e-3, 2e-4, 8e-4], [2e-3, -1e-3, 1e-3]], dtype=F64)
    splats = centre, form, torch.tensor([4.0, 2.0], dtype=F64)
    pairs = zip(found(splats, image(size)), expected(splats, image(size)), strict=True)
    for ours, theirs in pairs:
        torch.testing.assert_close(ours, theirs, rtol=1e-9, atol=1e-11 * float(theirs.abs().max()))


def test_an_image_beside_all_gaussians_is_worth_nothing() -> None:
    centre, form, thickness = blobs((40, 56))
    for shift in (1e3, -1e3, 1e18, float("nan")):
        value, *rest = found((centre + shift, form, thickness), image((40, 56)))
        assert float(value) == 0 and all(float(each.abs().max()) == 0 for each in rest)


@pytest.mark.parametrize("count", [1, 7, 500])
def test_fading_is_the_exponential(count: int) -> None:
    depth = np.random.default_rng(3).exponential(8.0, count)
    left = np.empty(count)
    fading(depth, left)
    np.testing.assert_allclose(left, np.exp(-depth), rtol=5e-16)


def test_fading_of_nothing_and_of_very_much() -> None:
    left = np.empty(3)
    fading(np.array([0.0, 700.0, 1e30]), left)
    assert left[0] == 1
    np.testing.assert_allclose(left[1:], np.exp(-700.0), rtol=5e-16)


def test_what_is_no_ellipse_is_not_drawn() -> None:
    """NaN, infinity and the like are no index: loops stay within the image."""
    draw, size = np.random.default_rng(3), (20, 25)
    odd = np.array([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e300, -1e300, 1e-300])
    edges, flat = np.ones((2, *size), np.float32), np.ones(size, np.float32)
    for _ in range(300):
        centre, thickness = draw.uniform(-10, 35, (3, 2)), draw.uniform(0, 3, 3)
        form = np.array([0.1, 0.01, 0.1]) * draw.uniform(0.5, 1, (3, 1))
        for part in (centre, form, thickness):
            some = draw.random(part.shape) < 0.3
            part[some] = draw.choice(odd, some.sum())
        into = (np.empty((3, 2)), np.empty((3, 3)), np.empty(3)), np.empty((3, 3))
        given = (centre, form, thickness), 1e-4, edges, flat
        assert np.isfinite(look(*given, 0.25, True, *into))
