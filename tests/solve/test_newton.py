"""Steps on the true Hessian: where they end, within bounds, and element by element."""

import pytest
import torch
from adjoint_problems import F64, problem
from polish import minimum

from perfcap.errors import InputError
from perfcap.solve import (
    GemanMcClure,
    LevenbergMarquardt,
    Newton,
    Objective,
    ResidualFunction,
    Status,
    Vector,
    solve,
)
from perfcap.solve.layout import Layout
from perfcap.solve.stationarity import gradient

SHORT = LevenbergMarquardt(max_steps=6)


@pytest.mark.long
@pytest.mark.parametrize("shared", [0, 3])
def test_ends_at_the_minimum(shared: int) -> None:
    objective, state, _ = problem(GemanMcClure(2.0), shared)
    found = solve(objective, state, Newton(SHORT))
    assert found.status.tolist() == [Status.CONVERGED] * 2
    rough = solve(objective, state, SHORT)
    with torch.no_grad():
        slopes = [
            gradient(objective, e.state, Layout.of(state)).abs().max() for e in (found, rough)
        ]
    assert float(slopes[0]) < 1e-9 < 1e-4 * float(slopes[1])
    assert bool((found.energy <= rough.energy).all())
    assert bool((found.steps > rough.steps).all())
    torch.testing.assert_close(found.energy, objective(found.state))


def test_stays_within_bounds_and_presses_against_them() -> None:
    objective, state, bounds = problem()
    found = solve(objective, state, Newton(SHORT), bounds).state
    exact = minimum(objective, state, bounds)
    torch.testing.assert_close(found.frame, exact.frame, rtol=0, atol=1e-8)
    assert bool((found.frame >= bounds.lower.frame).all())
    assert bool((found.frame <= bounds.upper.frame).all())
    assert bool((found.frame == bounds.upper.frame).any())


def test_a_batch_is_a_loop() -> None:
    objective = Objective(well=ResidualFunction(banana))
    starts = torch.tensor([[-1.2, 1.0], [0.3, -0.4], [2.0, 2.0]], dtype=F64)
    method = Newton(LevenbergMarquardt(max_steps=2), max_steps=60)
    both = solve(objective, Vector(starts), method)
    for index, start in enumerate(starts):
        alone = solve(objective, Vector(start), method)
        torch.testing.assert_close(both.state.values[index], alone.state.values)
        assert int(both.status[index]) == int(alone.status) == Status.CONVERGED
        assert int(both.steps[index]) == int(alone.steps)
    torch.testing.assert_close(both.state.values, torch.ones(3, 2, dtype=F64))


def banana(x: torch.Tensor) -> torch.Tensor:
    return torch.stack((10 * (x[..., 1] - x[..., 0] ** 2), 1 - x[..., 0]), -1)


def test_leaves_a_saddle() -> None:
    """Where the Hessian is not positive, a step is damped until the energy falls."""
    well = ResidualFunction(lambda x: torch.stack((x[..., 0] ** 2 - 1, x[..., 1]), -1))
    objective = Objective(well=well)
    start = Vector(torch.tensor([1e-3, 0.5], dtype=F64))
    found = solve(objective, start, Newton(LevenbergMarquardt(max_steps=0)))
    assert int(found.status) == Status.CONVERGED
    torch.testing.assert_close(found.state.values, torch.tensor([1.0, 0.0], dtype=F64))


def test_an_element_that_is_not_finite_stays() -> None:
    objective, state, _ = problem()
    data = objective.energies["data"]
    data.target = data.target.clone()
    data.target[0, 1] = torch.nan
    found = solve(objective, state, Newton(SHORT))
    assert found.status.tolist() == [Status.NOT_FINITE, Status.CONVERGED]
    torch.testing.assert_close(found.state.frame[0], state.frame[0], rtol=0, atol=0)


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(InputError, match="max_steps"):
        Newton(max_steps=-1)
    with pytest.raises(InputError, match="tolerance"):
        Newton(tolerance=float("nan"))
