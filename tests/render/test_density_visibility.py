"""Visibility of Gaussians: it adds up, is that of a medium, and hides what lies behind."""

import torch
from synthetic import cameras as circle

from perfcap.render.density import Splats, background, visibilities

F64 = torch.float64
SIZE = 120


def scene() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    points = torch.tensor([[0.0, 1.0, 0.3], [0.0, 1.0, -0.3], [0.3, 1.3, 0.0]], dtype=F64)
    return points, torch.tensor([0.08, 0.1, 0.05], dtype=F64), torch.full((3,), 30.0, dtype=F64)


def grid() -> torch.Tensor:
    y, x = torch.meshgrid(torch.arange(SIZE), torch.arange(SIZE), indexing="ij")
    return torch.stack((x, y), -1).reshape(-1, 2).double()


def test_all_that_is_seen_adds_up() -> None:
    camera = circle(1, size=SIZE)
    seen, left = visibilities(camera, *scene(), grid())
    torch.testing.assert_close(seen.sum(-1) + left, torch.ones(SIZE**2, dtype=F64))
    assert bool((seen >= 0).all())
    points, wide, dense = scene()
    expected, _ = background(Splats.seen_by(camera, points[None], wide, dense), (SIZE, SIZE))
    torch.testing.assert_close(left, expected[0, 0].reshape(-1), atol=0.02, rtol=0)


def test_what_is_in_front_hides_what_is_behind() -> None:
    camera = circle(1, size=SIZE)
    toward = torch.nn.functional.normalize(camera.centre[0] - torch.tensor([0.0, 1.0, 0.0]), dim=0)
    middle = torch.tensor([0.0, 1.0, 0.0], dtype=F64)
    points = torch.stack((middle + 0.4 * toward, middle - 0.4 * toward))
    wide, dense = torch.full((2,), 0.08, dtype=F64), torch.full((2,), 30.0, dtype=F64)
    seen, _ = visibilities(camera, points, wide, dense, camera.project(middle[None])[0])
    assert float(seen[0, 0]) > 0.95 and float(seen[0, 1]) < 0.05


def test_against_fine_steps_along_rays() -> None:
    camera = circle(1, size=SIZE)
    points, wide, dense = scene()
    at = camera.project(points[2:])[0] + 2.0
    seen, _ = visibilities(camera, points, wide, dense, at)
    local, plane = camera.to_camera(points)[0], camera.to_plane(at[None])[0, 0]
    ray = torch.cat((plane, plane.new_ones(1)))
    along = torch.linspace(0, 10, 40001, dtype=F64)
    places = along[:, None] * ray / ray.norm()
    squared = (places[:, None] - local).square().sum(-1)
    each = dense * torch.exp(-0.5 * squared / wide.square())
    step = float(along[1])
    light = torch.exp(-torch.cumsum(each.sum(-1), 0) * step)
    expected = (light[:, None] * each).sum(0) * step
    torch.testing.assert_close(seen[0], expected, atol=0.03, rtol=0)
