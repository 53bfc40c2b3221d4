"""Triangulation of points seen in several views."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.geometry.triangulation import triangulate

VIEWS = 4


def ring(views: int = VIEWS, frames: int | None = None, lens: bool = True) -> Camera:
    """Cameras around the origin, 4 m away, looking in; with ``frames`` they drift upwards."""
    yaw = torch.arange(views, dtype=torch.float64) * 0.8
    rotation = rotvec_to_matrix(torch.stack((0 * yaw, yaw, 0 * yaw), -1))
    translation = torch.tensor([0.1, -0.2, 4.0], dtype=torch.float64).expand(views, 3)
    if frames is not None:
        rotation = rotation.expand(frames, -1, -1, -1)
        rise = torch.arange(frames, dtype=torch.float64)[:, None, None] * 0.1
        translation = translation + rise * torch.tensor([0.0, 1, 0], dtype=torch.float64)
    intrinsics = torch.tensor([[900.0, 0, 320], [0, 910, 240], [0, 0, 1]], dtype=torch.float64)
    batch = rotation.shape[:-2]
    coefficients = torch.tensor([-0.1, 0.05, 1e-3, -2e-3, 0.01], dtype=torch.float64)
    return Camera(
        intrinsics.expand(*batch, 3, 3),
        rotation,
        translation,
        coefficients.expand(*batch, 5) if lens else None,
        ((480, 640),) * views,
    )


def points(frames: int = 3, count: int = 5) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.rand(frames, count, 3, generator=generator, dtype=torch.float64) - 0.5


def observe(camera: Camera, truth: Tensor) -> tuple[Tensor, Tensor]:
    plane = camera.to_plane(camera.project(truth))
    return plane, torch.ones_like(plane[..., 0])


@pytest.mark.parametrize("frames", [None, 3])
@pytest.mark.parametrize("rounds", [0, 6])
def test_recovers_points(frames: int | None, rounds: int) -> None:
    camera, truth = ring(frames=frames), points()
    found, residual = triangulate(camera, *observe(camera, truth), rounds)
    torch.testing.assert_close(found, truth, atol=1e-6, rtol=0)
    assert (residual < 1e-6).all()


def test_one_wrong_view_loses_its_say() -> None:
    camera, truth = ring(5), points()
    plane, weights = observe(camera, truth)
    plane[:, 2] += torch.tensor([0.1, -0.08])
    robust, residual = triangulate(camera, plane, weights)
    plain, _ = triangulate(camera, plane, weights, rounds=0)
    assert (robust - truth).norm(dim=-1).max() < 0.02 < (plain - truth).norm(dim=-1).min()
    assert (residual > 0.03).all()  # what was given is still wrong, and said so


def test_weight_zero_is_unseen() -> None:
    camera, truth = ring(), points()
    plane, weights = observe(camera, truth)
    plane[0, 1, 2] = 77
    weights[0, 1, 2] = 0
    weights[1, :3, 0] = 0  # one view left
    weights[2, :, 4] = 0  # none
    found, residual = triangulate(camera, plane, weights)
    lost = torch.zeros_like(residual, dtype=torch.bool)
    lost[1, 0] = lost[2, 4] = True
    assert torch.equal(found.isnan().all(-1), lost) and torch.equal(residual.isnan(), lost)
    torch.testing.assert_close(found[~lost], truth[~lost], atol=1e-6, rtol=0)


def test_parallel_rays_do_not_cross() -> None:
    camera = ring(2, lens=False)
    camera = replace(
        camera, rotation=camera.rotation[:1].expand(2, 3, 3), translation=camera.translation * 1.0
    )
    found, _ = triangulate(camera, *observe(camera, points()))
    assert found.isnan().all()


def test_two_views_of_noisy_points_stay_near() -> None:
    camera, truth = ring(2), points()
    plane, weights = observe(camera, truth)
    noise = torch.randn(plane.shape, generator=torch.Generator().manual_seed(2), dtype=plane.dtype)
    found, residual = triangulate(camera, plane + 1e-3 * noise, weights)
    assert (found - truth).norm(dim=-1).max() < 0.03
    assert (residual < 3e-3).all()


def test_far_world_origin_in_single_precision() -> None:
    camera, truth = ring(lens=False), points()
    far = torch.tensor([3000.0, -5000, 800], dtype=torch.float64)
    moved = replace(
        camera, translation=camera.translation - (camera.rotation @ far[:, None]).squeeze(-1)
    )
    plane, weights = observe(camera, truth)
    single = torch.zeros(1)
    found, _ = triangulate(moved.to(single), plane.to(single), weights.to(single))
    assert (found - far.float() - truth.float()).norm(dim=-1).max() < 5e-3


def test_batch_equals_loop() -> None:
    camera = ring()
    plane, weights = observe(camera, points(6))
    weights = weights * torch.linspace(0.2, 1, VIEWS, dtype=torch.float64)[:, None]
    plane = plane + 0.004 * torch.sin(torch.arange(plane.numel()).reshape(plane.shape))
    batched = plane.reshape(2, 3, *plane.shape[1:]), weights.reshape(2, 3, *weights.shape[1:])
    found, residual = triangulate(camera, *batched)
    for f in range(6):
        one = triangulate(camera, plane[f : f + 1], weights[f : f + 1])
        torch.testing.assert_close(
            (found[f // 3, f % 3], residual[f // 3, f % 3]), (one[0][0], one[1][0])
        )


def test_derivative() -> None:
    camera, truth = ring(3), points(1, 2)
    plane, weights = observe(camera, truth)
    generator = torch.Generator().manual_seed(3)
    noise = torch.randn(plane.shape, generator=generator, dtype=plane.dtype)
    noisy = (plane + 2e-3 * noise).requires_grad_()
    weights = (
        0.3 + torch.rand(weights.shape, generator=generator, dtype=plane.dtype)
    ).requires_grad_()
    assert torch.autograd.gradcheck(lambda p, w: triangulate(camera, p, w, 2), (noisy, weights))


def test_derivative_is_finite_where_rays_meet_and_where_points_are_lost() -> None:
    camera, truth = ring(lens=False), points()
    plane, weights = observe(camera, truth)
    weights[0, :, 0] = 0
    plane.requires_grad_()
    found, residual = triangulate(camera, plane, weights)
    (found.nan_to_num().sum() + residual.nan_to_num().sum()).backward()
    assert plane.grad is not None and plane.grad.isfinite().all()


def test_places_that_are_not_seen_may_be_any_number() -> None:
    camera, truth = ring(), points()
    plane, weights = observe(camera, truth)
    plane[:, 1, 2], weights[:, 1, 2] = torch.nan, 0
    found, residual = triangulate(camera, plane, weights)
    torch.testing.assert_close(found, truth, rtol=0, atol=1e-6)
    assert residual.isfinite().all()
    weights[:, 2, 3] = torch.nan  # neither is its weight
    torch.testing.assert_close(triangulate(camera, plane, weights)[0], truth, rtol=0, atol=1e-6)
