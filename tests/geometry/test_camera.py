"""Cameras against OpenCV, their derivatives, and the points behind them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.geometry.camera import NEAR, Camera
from perfcap.geometry.rotation import rotvec_to_matrix

DISTORTION = (0.12, -0.08, 0.004, -0.003, 0.02)
F64 = torch.float64


def rig(views: int = 3, distortion: bool = True, lead: tuple[int, ...] = ()) -> Camera:
    """Views in different places with different lenses."""
    random = torch.Generator().manual_seed(5)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*lead, views, *shape, generator=random, dtype=F64)

    focal = torch.tensor([900.0, 920.0], dtype=F64) + 5 * normal(2)
    intrinsics = torch.eye(3, dtype=F64).repeat(*lead, views, 1, 1)
    intrinsics[..., (0, 1), (0, 1)] = focal
    intrinsics[..., :2, 2] = torch.tensor([310.0, 250.0], dtype=F64)
    return Camera(
        intrinsics=intrinsics,
        rotation=rotvec_to_matrix(0.2 * normal(3)),
        translation=torch.tensor([0.0, 0.0, 4.0], dtype=F64) + 0.2 * normal(3),
        distortion=torch.tensor(DISTORTION, dtype=F64) * (1 + 0.1 * normal(1))
        if distortion
        else None,
        size=((480, 640),) * views,
    )


def cloud(*lead: int, count: int = 20) -> Tensor:
    random = torch.Generator().manual_seed(6)
    return torch.randn(*lead, count, 3, generator=random, dtype=F64) * 0.6


@pytest.mark.parametrize("distortion", [False, True])
def test_projection_agrees_with_opencv(distortion: bool) -> None:
    camera, points = rig(distortion=distortion), cloud()
    pixels = camera.project(points)
    for view in range(3):
        coefficients = None if camera.distortion is None else camera.distortion[view].numpy()
        expected, _ = cv2.projectPoints(
            points.numpy(),
            cv2.Rodrigues(camera.rotation[view].numpy())[0],
            camera.translation[view].numpy(),
            camera.intrinsics[view].numpy(),
            coefficients,
        )
        assert np.allclose(pixels[view].numpy(), expected.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize("distortion", [False, True])
@pytest.mark.parametrize("moving", [False, True])
def test_derivative_agrees_with_forward_mode(distortion: bool, moving: bool) -> None:
    camera = rig(distortion=distortion, lead=(4,) if moving else ())
    points = cloud(2, 4, count=5)
    tangents = torch.eye(3, dtype=F64)
    columns = [
        torch.func.jvp(camera.project, (points,), (tangent.expand_as(points),))[1]
        for tangent in tangents
    ]
    pixels, jacobian = camera.linearize(points)
    assert torch.allclose(pixels, camera.project(points), atol=1e-10)
    assert torch.allclose(jacobian, torch.stack(columns, -1), atol=1e-9)


def test_plain_and_compiled_derivatives_agree() -> None:
    camera, points = rig(lead=(4,)), cloud(2, 4)
    points[0, 0, 0] *= 100  # far outside the image, where distortion is held constant
    points[0, 1, 0, 2] = -9.0  # behind
    for dtype, tolerance in ((F64, 1e-12), (torch.float32, 2e-5)):
        like = torch.zeros((), dtype=dtype)
        compiled = camera.to(like).linearize(points.to(like))
        plain = camera.to(like).linearize(points.to(like).requires_grad_())
        for one, other in zip(compiled, plain, strict=True):
            assert one.dtype == dtype
            error = (one - other.detach()).abs() / other.detach().abs().clamp(min=1000)
            assert error.max() < tolerance


def test_derivative_holds_where_distortion_is_constant() -> None:
    camera = rig()
    points = torch.tensor([[3.0, 1.0, 0.0], [-2.0, 3.0, 0.5]], dtype=F64)
    plane = camera.to_camera(points)
    assert ((plane[..., :2] / plane[..., 2:]).square().sum(-1) > camera.radius_limit()).all()
    jacobian = camera.linearize(points)[1]
    step = 1e-6
    for axis in range(3):
        move = step * torch.eye(3, dtype=F64)[axis]
        difference = (camera.project(points + move) - camera.project(points - move)) / (2 * step)
        assert torch.allclose(jacobian[..., axis], difference, rtol=1e-6, atol=1e-4)


def test_distant_points_stay_far_from_the_image() -> None:
    """Polynomials fold back outside the image; held constant they cannot bring a point inside."""
    camera = rig(1)
    camera = replace(camera, rotation=torch.eye(3, dtype=F64)[None])
    points = torch.linspace(0.5, 60, 200, dtype=F64)[:, None] * torch.tensor([1.0, 0.2, 0.0])
    columns = camera.project(points)[0, :, 0]
    assert (columns.diff() > 0).all()


def test_points_behind_the_camera_are_finite_and_pulled_forward() -> None:
    camera = Camera(
        torch.tensor([[[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]], dtype=F64),
        torch.eye(3, dtype=F64)[None],
        torch.zeros(1, 3, dtype=F64),
    )
    points = torch.tensor([[0.1, 0.2, -3.0], [0.1, 0.2, 0.0], [0.0, 0.0, 0.0]], dtype=F64)
    pixels, jacobian = camera.linearize(points)
    assert torch.allclose(pixels[0], 100 * points[:, :2] / NEAR + 50)
    assert torch.isfinite(jacobian).all()
    assert (jacobian[..., 2] == 0).all()
    assert (jacobian[0, :, 0, 0] > 0).all()  # not mirrored: moving right moves right


@pytest.mark.parametrize("distortion", [False, True])
def test_plane_coordinates_undo_projection(distortion: bool) -> None:
    camera, points = rig(distortion=distortion), cloud()
    local = camera.to_camera(points)
    plane = camera.to_plane(camera.project(points))
    inside = ((camera.project(points) > 0) & (camera.project(points) < 500)).all(-1)
    expected = local[..., :2] / local[..., 2:]
    assert inside.sum() > 10
    assert torch.allclose(plane[inside], expected[inside], atol=1e-8)


def test_moving_cameras_are_a_camera_a_frame() -> None:
    camera, points = rig(lead=(4,)), cloud(4)
    together = camera.project(points)
    assert camera.moving
    assert together.shape == (4, 3, 20, 2)
    for frame in range(4):
        fixed = Camera(
            camera.intrinsics[frame],
            camera.rotation[frame],
            camera.translation[frame],
            None if camera.distortion is None else camera.distortion[frame],
            camera.size,
        )
        assert torch.allclose(together[frame], fixed.project(points[frame]), atol=1e-10)
        assert torch.allclose(
            camera.linearize(points)[1][frame], fixed.linearize(points[frame])[1], atol=1e-10
        )


def test_batched_cameras_follow_their_window() -> None:
    camera, points = rig(lead=(2, 4)), cloud(2, 4)
    pixels, jacobian = camera.linearize(points)
    plain, _ = camera.linearize(points.clone().requires_grad_())
    assert jacobian.shape == (2, 4, 3, 20, 2, 3)
    assert torch.allclose(pixels, plain.detach(), atol=1e-10)


def test_selecting_frames_and_views() -> None:
    camera, points = rig(lead=(4,)), cloud(4)
    part = camera.frames(slice(1, 3)).select([2, 0])
    expected = camera.project(points)[1:3][:, [2, 0]]
    assert torch.allclose(part.project(points[1:3]), expected)
    assert part.size == ((480, 640),) * 2
    index = torch.tensor([3, 0])
    assert torch.equal(camera.frames(index).rotation, camera.rotation[index])
    fixed = rig()
    assert fixed.frames(slice(0, 1)) is fixed
    assert not fixed.moving


def test_more_views_have_their_sizes() -> None:
    one = rig(1)
    first, second = replace(one, size=((4, 6),)), replace(one, size=((8, 9),))
    assert Camera.cat([first, second]).size == ((4, 6), (8, 9))
    assert Camera.cat([first, replace(one, size=())]).size == ()
    longer = Camera.cat([first.every_frame(2), first.every_frame(3)])
    assert longer.size == ((4, 6),) and len(longer.rotation) == 5


@pytest.mark.parametrize("distortion", [False, True])
def test_frames_apart_are_the_same_cameras(distortion: bool) -> None:
    camera, points = rig(distortion=distortion, lead=(4,)), cloud(4)
    apart = camera.apart().project(points[:, None])
    assert torch.allclose(apart[:, 0], camera.project(points))
    fixed = rig(distortion=distortion)
    assert fixed.apart() is fixed
    assert torch.allclose(fixed.project(points[:, None])[:, 0], fixed.project(points))


def test_centre_projects_nowhere_else() -> None:
    camera = rig()
    assert torch.allclose(
        camera.to_camera(camera.centre)[0, 0], torch.zeros(3, dtype=F64), atol=1e-12
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rotation": torch.eye(3)}, "rotation has shape"),
        ({"translation": torch.zeros(2, 3)}, "translation has shape"),
        ({"distortion": torch.zeros(3, 4)}, "k1, k2, p1, p2, k3"),
    ],
)
def test_wrong_shapes_are_refused(change: dict[str, Tensor], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(rig(), **change)  # type: ignore[arg-type]


def test_views_are_chosen_by_flags_too() -> None:
    camera = replace(rig(), size=((1, 2), (3, 4), (5, 6)))
    flags, places = camera.select([True, False, True]), camera.select([0, -1])
    assert flags.size == places.size == ((1, 2), (5, 6))
    assert torch.equal(flags.translation, places.translation)


@pytest.mark.parametrize("shape", [(3, 4, 4), (3, 4, 2), (3,)])
def test_points_of_other_axes_are_refused(shape: tuple[int, ...]) -> None:
    """Compiled loops wrote beyond the end of arrays."""
    with pytest.raises(InputError, match="points have shape"):
        rig().linearize(torch.ones(shape, dtype=torch.float64))


def test_no_points_have_no_pixels() -> None:
    pixels, slope = rig().linearize(torch.ones(2, 0, 3, dtype=torch.float64))
    assert pixels.shape == (2, 3, 0, 2) and slope.shape == (2, 3, 0, 2, 3)
