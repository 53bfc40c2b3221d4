"""Least-squares problems of the literature: right answers, honest claims, and no unit matters."""

import pytest
import torch
from classical_problems import Classic, bounded, unbounded
from scipy.optimize import least_squares

from perfcap.solve import LevenbergMarquardt, Status, solve

TEXTBOOK = LevenbergMarquardt(max_steps=1000, tolerance=0, damping=1e-2)
PROBLEMS = {problem.name: problem for problem in (*unbounded(), *bounded())}
FEW = ("Freudenstein and Roth x10", "Bard", "Kowalik and Osborne", "Osborne", "Wood")
FEW += ("Brown and Dennis x100", "Biggs, held", "Brown and Dennis, held", "penalty, held")


def first_order(problem: Classic, x: torch.Tensor) -> float:
    """Largest cosine between the residual and a column of the Jacobian that is free to move."""
    jacobian, residual = torch.func.jacfwd(problem.residual)(x), problem.residual(x)
    slope, length = jacobian.mT @ residual, jacobian.norm(dim=0)
    free = length > 0
    if (bounds := problem.bounds()) is not None:
        lower, upper = bounds
        free &= ~((x <= lower) & (slope > 0)) & ~((x >= upper) & (slope < 0))
    cosine = slope.abs() / (length * residual.norm()).clamp(min=1e-300)
    return float(torch.where(free, cosine, 0).max())


def is_exhausted(problem: Classic, energy: float) -> bool:
    """Whether all but rounding of the residuals is gone."""
    return energy <= 1e-20 * float(problem.residual(problem.initial()).square().sum())


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=(pytest.mark.slow,) * n.endswith("0")) for n in PROBLEMS]
)
def test_one_line_of_settings_finds_the_known_minimum(name):
    problem = PROBLEMS[name]
    found = solve(problem.residual, problem.initial(), TEXTBOOK, problem.bounds())
    energy = float(found.energy)
    exhausted = 0 in problem.minima and is_exhausted(problem, energy)
    assert exhausted or any(energy == pytest.approx(least, rel=1e-6) for least in problem.minima)
    if found.status == Status.CONVERGED and not exhausted:
        assert first_order(problem, found.state) < 1e-6


SETTINGS = {
    "default": LevenbergMarquardt(),
    "loose": LevenbergMarquardt(tolerance=1e-3),
    "damped": LevenbergMarquardt(damping=1e6),
    "undamped": LevenbergMarquardt(damping=1e-12),
    "short": LevenbergMarquardt(max_steps=5, tolerance=1e-2),
}


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [pytest.param(name, marks=() if name == "default" else pytest.mark.slow) for name in SETTINGS],
)
def test_convergence_is_claimed_only_at_first_order_points(settings):
    method, claims = SETTINGS[settings], 0
    for problem in PROBLEMS.values():
        found = solve(problem.residual, problem.initial(), method, problem.bounds())
        if found.status == Status.CONVERGED and not is_exhausted(problem, float(found.energy)):
            claims += 1
            # the claim is of the state before the last step, which is no longer than that
            assert first_order(problem, found.state) < 2 * method.tolerance**0.5, problem.name
    assert claims > (0 if settings == "short" else 10)


@pytest.mark.long
@pytest.mark.parametrize("name", FEW)
def test_units_of_unknowns_change_neither_steps_nor_answer(name):
    problem = PROBLEMS[name]
    random = torch.Generator().manual_seed(len(name))
    bounds = problem.bounds()
    plain = solve(problem.residual, problem.initial(), bounds=bounds)
    for _ in range(3):
        # powers of two up to about 1e±6 leave every rounding as it is
        power = torch.randint(-20, 21, problem.initial().shape, generator=random)
        unit = 2.0 ** power.double()
        box = bounds and (bounds[0] / unit, bounds[1] / unit)
        scaled = solve(
            lambda x, u=unit: problem.residual(x * u), problem.initial() / unit, None, box
        )
        assert int(scaled.steps) == int(plain.steps)
        assert scaled.status == plain.status
        torch.testing.assert_close(scaled.state * unit, plain.state, rtol=1e-9, atol=1e-12)
        torch.testing.assert_close(scaled.energy, plain.energy, rtol=1e-9, atol=0)


def test_a_direction_that_fades_is_no_minimum():
    """BoxBOD from NIST's first start: the rate runs away, and its column fades to nothing."""
    x = torch.tensor([1.0, 2, 3, 5, 7, 10], dtype=torch.float64)
    y = torch.tensor([109.0, 149, 149, 191, 213, 224], dtype=torch.float64)
    problem = Classic(
        "BoxBOD", lambda b: b[0] * (1 - (-b[1] * x).exp()) - y, (1, 1), (1168.0088766,)
    )
    away = solve(problem.residual, problem.initial(), TEXTBOOK)
    assert first_order(problem, away.state) > 0.1
    assert away.status != Status.CONVERGED
    near = solve(problem.residual, torch.tensor([100, 0.75], dtype=torch.float64), TEXTBOOK)
    assert near.status == Status.CONVERGED
    assert float(near.energy) == pytest.approx(1168.0088766, rel=1e-9)


@pytest.mark.parametrize("problem", bounded(), ids=lambda problem: problem.name)
def test_answers_in_boxes_are_those_of_another_solver(problem):
    lower, upper = (side.numpy() for side in problem.bounds())
    found = solve(problem.residual, problem.initial(), TEXTBOOK, problem.bounds())
    other = least_squares(
        lambda x: problem.residual(torch.tensor(x)).numpy(),
        found.state.numpy().clip(lower + 1e-9, upper - 1e-9),
        jac=lambda x: torch.func.jacfwd(problem.residual)(torch.tensor(x)).numpy(),
        bounds=(lower, upper),
        x_scale="jac",
        **dict.fromkeys(("xtol", "ftol", "gtol"), 1e-14),
    )
    assert float(found.energy) <= 2 * other.cost * (1 + 1e-9) + 1e-20


@pytest.mark.long
def test_nothing_moves_where_nothing_is_seen():
    found = solve(lambda x: x[:1] - 3, torch.tensor([0.0, 7.0]), TEXTBOOK)
    torch.testing.assert_close(found.state, torch.tensor([3.0, 7.0]))
    assert found.status == Status.CONVERGED


def test_a_saddle_is_a_first_order_point():
    """x^2 - y^2 as squares: at its saddle no column sees the residual."""
    found = solve(lambda x: torch.stack((x[0], x[1] ** 2 - 4)), torch.zeros(2).double())
    assert found.status == Status.CONVERGED
    off = solve(lambda x: torch.stack((x[0], x[1] ** 2 - 4)), torch.tensor([0.0, 1e-3]).double())
    assert float(off.state[1]) == pytest.approx(2, abs=1e-6)
