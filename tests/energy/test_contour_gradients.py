"""Second derivatives of contours, and gradients through solves that contours take part in."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor
from synthetic import cameras as circle
from test_density_contour import Seen, body, near, seen, truth
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.density_contour import DensityContour
from perfcap.energy.prior import PosePrior
from perfcap.energy.reprojection import Reprojection
from perfcap.geometry.camera import Camera
from perfcap.geometry.plain import torch_only
from perfcap.render.density import Splats, background
from perfcap.segment.edge_tensors import TensorField, edge_tensors
from perfcap.solve import (
    Detached,
    GemanMcClure,
    Implicit,
    LevenbergMarquardt,
    Newton,
    Objective,
    Sensitivity,
    Solution,
    solve,
)
from perfcap.solve.layout import Layout
from perfcap.solve.stationarity import gradient

F64 = torch.float64


def recorded(energy: DensityContour) -> list[list[Seen]]:
    """Its fields as tensors that want gradients."""
    return [
        [
            Seen(
                torch.tensor(each.edges).double().requires_grad_(),
                torch.tensor(each.flat).double().requires_grad_(),
                each.corner,
            )
            for each in row
        ]
        for row in energy.fields
    ]


def drawn(like: Tensor, seed: int) -> Tensor:
    return torch.randn(like.shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


def wider(points: Tensor) -> Tensor:
    """Points with logarithms of widths."""
    _, volume = body()
    return torch.cat((points, volume.deviations.log().expand(points.shape[:-1])[..., None]), -1)


@pytest.mark.parametrize("widths", [False, True])
def test_second_derivative_against_differences(widths: bool) -> None:
    energy, points = seen(truth())
    here = points(near(truth()))
    here = wider(here) if widths else here
    moves = drawn(here[..., None].expand(*here.shape, 3), 1)
    found = energy.second_derivative(here, moves)
    for k in range(3):
        way = 1e-6 * moves[..., k]
        ahead, behind = (energy.expand(here + s * way).gradient for s in (1, -1))
        rows = ((ahead - behind)[..., None] * moves).sum((-3, -2)) / 2e-6
        torch.testing.assert_close(
            found[:, k], rows, rtol=1e-3, atol=1e-4 * float(found.abs().max())
        )
    torch.testing.assert_close(found, found.mT)


@pytest.mark.long
def test_kernels_bend_like_plain_torch() -> None:
    energy, points = seen(truth(), 60)
    here = wider(points(near(truth())))
    moves = drawn(here[..., None].expand(*here.shape, 2), 2)
    fast = energy.second_derivative(here, moves)
    with torch_only():
        torch.testing.assert_close(
            energy.second_derivative(here, moves), fast, rtol=1e-6, atol=1e-6
        )


def test_the_slope_is_a_function_of_all_that_it_is_made_of() -> None:
    """Its derivatives in points, widths, cameras and fields are those of plain torch."""
    energy, points = seen(truth(), 60)
    _, volume = body()

    def gradients() -> list[Tensor]:
        fields = recorded(energy)
        wide = volume.deviations.clone().requires_grad_()
        lens = energy.cameras.intrinsics.clone().requires_grad_()
        cameras = replace(energy.cameras, intrinsics=lens)
        own = DensityContour(points, replace(volume, deviations=wide), cameras, fields, unit=0.7)
        here = points(near(truth())).requires_grad_()
        slope = own.slope(here)
        seen_by = [part for row in fields for each in row for part in (each.edges, each.flat)]
        held = [here, wide, lens, *seen_by]
        return [slope.detach(), *torch.autograd.grad((slope * drawn(slope, 3)).sum(), held)]

    fast = gradients()
    with torch_only():
        plain = gradients()
    for ours, theirs in zip(fast, plain, strict=True):
        scale = float(theirs.abs().max())
        assert scale > 0
        torch.testing.assert_close(ours, theirs, rtol=1e-6, atol=1e-8 * scale)


def pictures(size: int) -> tuple[Camera, Tensor]:
    """Cameras and images (F, C, 3, H, W) of a body before a wall, pixels that want gradients."""
    points, volume = body()
    cameras = circle(3, size=size)
    splats = Splats.seen_by(cameras, points(truth()), volume.deviations, volume.densities)
    left = background(splats, (size, size))[0].unsqueeze(-3)
    tones = torch.tensor([[0.6, 0.5, 0.5], [0.2, 0.3, 0.4]], dtype=F64)
    wall, skin = tones[..., None, None]
    # nowhere flat: the strength of an edge has no derivative where it is zero
    x, y = torch.arange(size, dtype=F64), torch.arange(size, dtype=F64)[:, None]
    slant = 0.01 * (x + 0.6 * y) + 0.3 * torch.sin(0.05 * y + 0.07 * x)
    return cameras, (left * wall + (1 - left) * skin + slant).detach().requires_grad_()


def solved(
    cameras: Camera, images: Tensor, joints: Tensor, adjoint: Detached | Implicit, start: Motion
) -> Solution[Motion]:
    """The motion whose contours meet the edges of images, near detections."""
    points, volume = body()
    fields = [[TensorField.of(edge_tensors(view)) for view in row] for row in images]
    weight = torch.tensor(0.2, dtype=F64)
    contour = DensityContour(points, volume, cameras, fields, weight, offset=200.0)
    seen_by = Detections.from_joints(joints, torch.ones_like(joints[..., 0]))
    objective = Objective(
        contour=contour,
        joints=Reprojection(actor().landmarks, cameras, seen_by, 0.01, GemanMcClure(3.0)),
        prior=PosePrior(truth().angles.mean(0), 20.0, 1.0),
    )
    return solve(objective, start, Newton(LevenbergMarquardt(max_steps=20), 60), adjoint=adjoint)


@pytest.mark.long
def test_gradients_reach_images_and_detections_through_a_solve() -> None:
    cameras, images = pictures(64)
    exact = cameras.project(actor().landmarks(truth()))
    joints = (exact + 0.5 * drawn(exact, 1)).detach().requires_grad_()
    found = solved(cameras, images, joints, Implicit(), near(truth(), 0.005))
    assert found.sensitivity is not None and int(found.sensitivity) == Sensitivity.EXACT
    points, state = body()[0], found.state
    way = drawn(points(state), 4)
    slopes = torch.autograd.grad((points(state) * way).sum(), (images, joints))
    for which, step in enumerate((1e-5, 1e-4)):
        given = [images.detach(), joints.detach()]
        move, values = step * drawn(given[which], 5 + which), []
        for sign in (1, -1):
            moved = list(given)
            moved[which] = given[which] + sign * move
            again = solved(cameras, *moved, Detached(), state).state
            values.append(float((points(again) * way).sum()))
        change = (values[0] - values[1]) / 2
        assert float((slopes[which] * move).sum()) == pytest.approx(change, rel=1e-4)


@pytest.mark.long
def test_newton_ends_where_bounds_on_the_curvature_have_not() -> None:
    energy, _ = seen(truth(), 90)
    energy.weight = torch.tensor(0.2, dtype=F64)
    prior = PosePrior(truth().angles.mean(0) + 0.02, 20.0, 1.0)
    objective, rough = Objective(contour=energy, prior=prior), LevenbergMarquardt(max_steps=20)
    slopes = []
    for method in (rough, Newton(rough, 8)):
        state = solve(objective, near(truth(), 0.005), method).state
        with torch.no_grad():
            slopes.append(float(gradient(objective, state, Layout.of(state)).abs().max()))
    assert slopes[0] > 0.1 and slopes[1] < 1e-9
