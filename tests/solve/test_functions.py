"""``solve`` on bare functions and tensors, and what it says of input of another kind."""

import math

import pytest
import torch

from perfcap.errors import InputError
from perfcap.solve import (
    Adam,
    Bounds,
    Implicit,
    LevenbergMarquardt,
    Objective,
    ResidualFunction,
    Status,
    Unrolled,
    Vector,
    solve,
)

START = torch.tensor([-1.2, 1.0], dtype=torch.float64)


def rosenbrock(x):
    return torch.stack((10 * (x[..., 1] - x[..., 0] ** 2), 1 - x[..., 0]), -1)


def test_a_function_is_what_its_energy_is():
    bare = solve(rosenbrock, START)
    whole = solve(Objective(sum=ResidualFunction(rosenbrock)), Vector(START))
    assert torch.equal(bare.state, whole.state.values)
    assert int(bare.steps) == int(whole.steps)
    torch.testing.assert_close(bare.state, torch.ones(2).double())


@pytest.mark.parametrize("upper", [0.5, torch.tensor([0.5, 9.0]), torch.tensor(0.5)])
def test_bounds_are_a_pair_of_anything_that_broadcasts(upper):
    found = solve(rosenbrock, START, bounds=(None, upper))
    torch.testing.assert_close(found.state, torch.tensor([0.5, 0.25]).double())
    assert found.status == Status.CONVERGED


@pytest.mark.long
def test_a_batch_is_a_loop():
    starts = START + torch.linspace(-1, 1, 5).double()[:, None]
    together = solve(rosenbrock, starts, bounds=(-1.5, None))
    for k, start in enumerate(starts):
        alone = solve(rosenbrock, start, bounds=(-1.5, None))
        torch.testing.assert_close(together.state[k], alone.state)
        assert int(together.steps[k]) == int(alone.steps)


def test_gradients_reach_what_a_function_holds():
    target = torch.tensor(3.0, dtype=torch.float64, requires_grad=True)
    found = solve(lambda x: x**2 - target, torch.ones(1).double(), adjoint=Implicit())
    (slope,) = torch.autograd.grad(found.state.sum(), target)
    assert float(slope) == pytest.approx(0.5 / 3**0.5, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((3, START), "objective is a int"),
        ((ResidualFunction(rosenbrock), START), "as in Objective"),
        ((rosenbrock, [1.0, 2.0]), "initial is a list"),
        ((rosenbrock, torch.tensor([1, 2])), "initial is a Tensor torch.int64"),
        ((rosenbrock, START.half()), "initial state is torch.float16"),
        ((rosenbrock, torch.tensor(1.0)), r"Tensor torch.float32 \(\)"),
        ((lambda x: [x, x], START), "returned a list"),
        ((lambda x: x[..., :0], START), "no residuals, so that nothing is asked"),
        ((lambda x: x.sum(), START), r"returned shape \(\)"),
        ((lambda x: x.float(), START), "returned torch.float32"),
        ((Objective(sum=ResidualFunction(rosenbrock)), START), "without coordinates"),
    ],
)
def test_input_of_another_kind_is_named(given, message):
    with pytest.raises(InputError, match=message):
        solve(*given)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"bounds": 3}, "bounds are a int"),
        ({"bounds": Bounds.on_frames(START, START)}, "bounds are a Bounds"),
        ({"bounds": ("low", None)}, "lower bound is a str"),
        ({"bounds": (torch.zeros(3), None)}, "lower bound is a Tensor"),
        ({"bounds": (1.0, 0.0)}, "above its upper bound"),
        ({"method": 30}, "method is 30"),
        ({"adjoint": "implicit"}, "adjoint is 'implicit'"),
        ({"method": LevenbergMarquardt}, "method is <class"),
    ],
)
def test_arguments_of_another_kind_are_named(keywords, message):
    with pytest.raises(InputError, match=message):
        solve(rosenbrock, START, **keywords)


def test_bounds_of_another_kind_beside_an_objective_are_named():
    objective = Objective(sum=ResidualFunction(rosenbrock))
    with pytest.raises(InputError, match="bounds are a tuple"):
        solve(objective, Vector(START), bounds=(0.0, 1.0))


@pytest.mark.parametrize(
    "function",
    [lambda x: 2 * x.detach() - 1, lambda x: torch.tensor(x.tolist(), dtype=x.dtype)],
)
def test_functions_that_no_derivative_leads_through_are_named(function):
    with pytest.raises(InputError, match="does not depend on its unknowns by torch operations"):
        solve(function, torch.ones(2, dtype=torch.float64))


@pytest.mark.parametrize("transform", [torch.func.vmap, torch.func.jacrev])
def test_transforms_of_a_solve_are_refused_by_name(transform):
    def root(target):
        return solve(lambda x: x**2 - target, torch.ones(1).double(), adjoint=Implicit()).state

    with pytest.raises(InputError, match=r"solve cannot run inside of torch\.func"):
        transform(root)(torch.tensor([2.0, 3.0]).double())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LevenbergMarquardt(max_steps=2.5), "max_steps is 2.5"),
        (lambda: LevenbergMarquardt(max_steps=-1), "max_steps is -1"),
        (lambda: LevenbergMarquardt(tolerance=-1e-3), "tolerance is -0.001"),
        (lambda: LevenbergMarquardt(tolerance=float("nan")), "tolerance is nan"),
        (lambda: LevenbergMarquardt(damping=0.0), "damping is 0.0"),
        (lambda: Adam(learning_rate=-0.1), "learning_rate is -0.1"),
        (lambda: Adam(-1), "max_steps is -1"),
        (lambda: Adam(decay=(0.9, 1.0)), r"decay is \(0.9, 1.0\)"),
        (lambda: Adam(tolerance=float("nan")), "tolerance is nan"),
        (lambda: Unrolled(1.5), "steps is 1.5"),
    ],
)
def test_settings_that_are_none_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make()


def _turned(x, matrix):
    points = torch.tensor([[1.0, 0.0], [0.0, 2.0], [1.0, 1.0]], dtype=x.dtype)
    seen = points @ matrix(x.new_tensor([0.5])).mT + x.new_tensor([0.3, -0.2])
    return (points @ matrix(x).mT + x[1:] - seen).flatten()


def _stacked(x):
    c, s = x[0].cos(), x[0].sin()
    return torch.stack((c, -s, s, c)).reshape(2, 2)


@pytest.mark.parametrize(
    "matrix",
    [
        lambda x: torch.tensor([[x[0].cos(), -x[0].sin()], [x[0].sin(), x[0].cos()]]).to(x),
        lambda x: _stacked(torch.tensor([math.atan(math.tan(float(x[0].detach())))]).to(x)),
        lambda x: _stacked(x).detach(),
    ],
)
@pytest.mark.filterwarnings("ignore:Converting a tensor with requires_grad")
@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_unknowns_that_no_derivative_leads_to(matrix, kind):
    """The angle stayed at 0 for 0.5, and the solve had converged."""
    start = torch.zeros(3, dtype=kind)
    with pytest.raises(InputError, match=r"changes with unknowns \[0\], but no derivative"):
        solve(lambda x: _turned(x, matrix), start)
    right = solve(lambda x: _turned(x, _stacked), start)
    assert float(right.state[0]) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_derivatives_that_are_zero_where_a_solve_starts(kind):
    """Squares, hinges, and unknowns that nothing asks for."""
    start = torch.zeros(4, dtype=kind)

    def residual(x):
        return torch.stack((x[0] - 1, 9 * x[1] ** 2 + 1, x[2].relu(), (-x[2]).relu() * 3, x[0]))

    assert float(solve(residual, start).state[0]) == pytest.approx(0.5, abs=1e-3)
    batch = solve(lambda x: torch.cat((x[:, :1] - 1, x[:, 1:2].abs()), -1), start.expand(2, 4))
    assert batch.state[:, 0].tolist() == pytest.approx([1.0, 1.0], abs=1e-3)
