"""Second derivatives of contours, and gradients through solves that contours take part in."""

from dataclasses import replace

import pytest
import torch
from test_density_contour import Seen, body, near, seen, truth
from torch import Tensor

from perfcap.actor.motion import Motion
from perfcap.energy.density_contour import DensityContour
from perfcap.energy.prior import PosePrior
from perfcap.geometry.plain import torch_only
from perfcap.solve import (
    Detached,
    Implicit,
    LevenbergMarquardt,
    Newton,
    Objective,
    Sensitivity,
    solve,
)

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


def solved(
    fields: list[list[Seen]], rest: Tensor, adjoint: Detached | Implicit, start: Motion
) -> tuple[Motion, Tensor]:
    energy, points = seen(truth(), 90)
    own = DensityContour(
        points, body()[1], energy.cameras, fields, torch.tensor(0.2, dtype=F64), offset=200.0
    )
    objective = Objective(contour=own, prior=PosePrior(rest, 20.0, 1.0))
    method = Newton(LevenbergMarquardt(max_steps=20))
    found = solve(objective, start, method, adjoint=adjoint)
    return found.state, found.sensitivity


def test_gradients_reach_images_and_priors_through_a_solve() -> None:
    energy, points = seen(truth(), 90)
    rest = truth().angles.mean(0) + 0.02
    fields, wanted = recorded(energy), rest.clone().requires_grad_()
    start = near(truth(), 0.005)
    state, sensitivity = solved(fields, wanted, Implicit(), start)
    assert sensitivity.tolist() == int(Sensitivity.EXACT)
    way = drawn(points(state), 4)
    of = [fields[0][0].edges, fields[1][2].flat, wanted]
    found = torch.autograd.grad((points(state) * way).sum(), of)
    step = 1e-4
    moves = [step * drawn(each, 5 + index) for index, each in enumerate(of)]
    for index, (gradient, move) in enumerate(zip(found, moves, strict=True)):
        values = []
        for sign in (1, -1):
            with torch.no_grad():
                of[index].add_(sign * move)
                moved = solved(fields, wanted, Detached(), state)[0]
                values.append(float((points(moved) * way).sum()))
                of[index].sub_(sign * move)
        expected = (values[0] - values[1]) / 2
        assert float((gradient * move).sum()) == pytest.approx(expected, rel=1e-3)
