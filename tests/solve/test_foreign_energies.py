"""Energies of one's own that were accepted and silently wrong, or ended in tracebacks."""

import warnings
from dataclasses import replace

import pytest
import torch
from block_toy import Blocks, Chain
from toy import Frames, cosine_basis

from perfcap.errors import InputError
from perfcap.solve import (
    Adam,
    BlockLinearization,
    Bounds,
    Compound,
    Energy,
    Expansion,
    LevenbergMarquardt,
    Majorized,
    Objective,
    Residual,
    Status,
    TruncatedNewton,
    WindowEnergy,
    of_part,
    solve,
)

F64, F32 = torch.float64, torch.float32


def start(*lead, dtype=F64):
    return Frames(torch.zeros(*lead, 5, 3, dtype=dtype), torch.zeros(*lead, 0, dtype=dtype))


class Data(Energy[Frames]):
    """Values of one, in a closed form that a function changes."""

    def __init__(self, change=lambda linear: linear):
        super().__init__()
        self.change = change

    def residual(self, state):
        return Residual((state.frame - 1).unsqueeze(-1))

    def linearize(self, state):
        return self.change(super().linearize(state))


# --- Frames of blocks -----------------------------------------------------------------------------


class OneFrame(Chain):
    """Says of the first frame alone what it is asked of all."""

    def linearize_blocks(self, state):
        whole = super().linearize_blocks(state)
        value = whole.residual.value[:1]
        return BlockLinearization(Residual(value), whole.blocks[:1], whole.jacobian[:1])


def test_blocks_of_one_frame_are_not_those_of_all() -> None:
    """The other frames stayed where they were, and were said to have converged."""
    chain, state = OneFrame(torch.ones(2, 5, 2, dtype=F64)), Blocks(torch.zeros(2, 6, 2, dtype=F64))
    with pytest.raises(InputError, match=r"with \(\*b, F\) = \(2,\)"):
        solve(Objective(chain=chain), state, TruncatedNewton())
    with pytest.raises(InputError, match=r"with \(\*b, F\) = \(2,\)"):
        whole = Compound({"chain": state})
        solve(Objective(chain=of_part("chain", chain)), whole, LevenbergMarquardt())


class Shrinking(Chain):
    """Evaluated, it is that of the first frame."""

    def residual(self, state):
        whole = super().residual(state)
        return Residual(whole.value[:1]) if torch.is_grad_enabled() else whole


def test_values_of_one_frame_are_not_those_of_all() -> None:
    from perfcap.solve.sparse_problem import SparseProblem

    state = Blocks(torch.zeros(2, 6, 2, dtype=F64))
    objective = Objective(chain=Shrinking(torch.ones(2, 5, 2, dtype=F64)))
    with pytest.raises(InputError, match=r"groups \(1, 5\) for a state of frames \(2,\)"):
        SparseProblem.of(objective, state).evaluate(state)


def test_weights_of_more_than_batch_elements_in_frames_of_blocks() -> None:
    """One a frame ended in a traceback."""
    state = Blocks(torch.zeros(2, 6, 2, dtype=F64))
    chain = Chain(torch.ones(2, 5, 2, dtype=F64), weight=torch.ones(2, dtype=F64))
    with pytest.raises(InputError, match=r"energy 'chain' has weights \(2,\)"):
        solve(Objective(chain=chain), state, TruncatedNewton())


# --- Closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        lambda linear: replace(linear, frame=linear.frame.to(F32)),
        lambda linear: replace(linear, residual=Residual(linear.residual.value.to(F32))),
        lambda linear: replace(linear, frame=linear.frame.long()),
    ],
)
def test_closed_forms_of_another_type(change) -> None:
    """They ended in tracebacks."""
    with pytest.raises(InputError, match=r"Data.linearize returned torch\..* for unknowns of"):
        solve(Objective(data=Data(change)), start())


def test_closed_forms_that_are_none() -> None:
    for change in (lambda linear: None, lambda linear: (linear.residual, linear.frame)):
        with pytest.raises(InputError, match=r"Data.linearize returned a \w+; expected a Lineari"):
            solve(Objective(data=Data(change)), start())
    wrong = Data(lambda linear: replace(linear, value=torch.ones(4, dtype=F64)))
    with pytest.raises(InputError, match=r"Data has energies \(4,\)"):
        solve(Objective(data=wrong), start())


class Added(Data):
    """Adds a gradient that a number scales, of values that another one does."""

    def __init__(self, slope, value=1.0):
        super().__init__()
        self.slope, self.value = slope, value

    def add_to_blocks(self, state, curvature, gradient):
        gradient += self.slope * (state.frame - 1)
        curvature += torch.eye(3, dtype=F64)
        value = self.value * (state.frame - 1).square().sum((-2, -1)).reshape(-1)
        return value if self.value else 0.0


def test_a_value_that_is_no_tensor() -> None:
    with pytest.raises(InputError, match="add_to_blocks returned a float"):
        solve(Objective(data=Added(1.0, 0.0)), start())


def test_no_slope_is_told_from_a_minimum() -> None:
    """A solve that stood still was said to have converged."""
    flat = Data(lambda linear: replace(linear, frame=0 * linear.frame))
    for energy in (flat, Added(0.0)):
        with pytest.warns(UserWarning, match="energy 'data': the closed form of"):
            found = solve(Objective(data=energy), start())
        assert found.status == Status.CONVERGED
    ones = Frames(torch.ones(5, 3, dtype=F64), torch.zeros(0, dtype=F64))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solve(Objective(data=Added(1.0)), start())
        there = solve(Objective(data=Added(1.0), other=Constant()), ones)
    assert float(there.energy) > 0


class Constant(Data):
    """Nothing changes it, as it says; elsewhere that is warned of."""

    def residual(self, state):
        return Residual(torch.ones_like(state.frame).unsqueeze(-1) + 0 * state.frame.unsqueeze(-1))


# --- Along time -----------------------------------------------------------------------------------


class Window(WindowEnergy[Frames]):
    """Features that are a function of the frames."""

    def __init__(self, function, dtype=F64):
        super().__init__(cosine_basis(2, 5).to(dtype), torch.ones(2, dtype=dtype))
        self.function = function

    def features(self, state):
        return self.function(state.frame)


@pytest.mark.parametrize(
    "function",
    [
        lambda x: torch.cat((x[..., 1:, :] - x[..., :-1, :], x[..., :1, :] * 0), -2),
        lambda x: x.cumsum(-2),
        lambda x: x - x.mean(-2, keepdim=True),
    ],
)
def test_features_that_see_other_frames(function) -> None:
    """Differences along time have the same derivative as nothing at all: they had no effect."""
    with pytest.raises(InputError, match="energy 'window' has features that see other frames"):
        solve(Objective(data=Data(), window=Window(function)), start(2))
    solve(Objective(data=Data(), window=Window(torch.sin)), start(2))


def test_features_of_another_type() -> None:
    """They ended in tracebacks."""
    for window, state, message in (
        (Window(torch.sin), start(dtype=F32), r"filters along a basis of torch.float64"),
        (Window(torch.Tensor.float), start(), "returned torch.float32, torch.float32"),
        (Window(lambda x: None), start(), "returned features NoneType"),
        (Window(lambda x: x[:2]), start(), r"returned features \(2, 3\)"),
    ):
        with pytest.raises(InputError, match=message):
            solve(Objective(data=Data(), window=window), state)
    with pytest.raises(InputError, match=r"along a basis of torch.float64"):
        solve(Objective(window=Window(torch.sin)), start(dtype=F32), Adam())


# --- Energies that are no sum of squares ----------------------------------------------------------


class Values:
    """The three numbers of a frame as one point."""

    sees = ()

    def __call__(self, state):
        return state.frame.unsqueeze(-2)

    def linearize(self, state):
        points = self(state)
        return points, torch.eye(3).to(points).expand(*points.shape, 3), None


class Bowl(Majorized[Frames]):
    """Squared distance from one, in an expansion that a function changes."""

    def __init__(self, change):
        super().__init__(Values())
        self.change = change

    def values(self, points):
        return (points - 1).square().sum((-2, -1))

    def expand(self, points):
        bent = 2 * torch.eye(3).to(points).expand(*points.shape, 3)
        return self.change(Expansion(self.values(points), 2 * (points - 1), bent))


def test_a_curvature_that_is_no_number_ends_its_own_element() -> None:
    """It ended in a traceback, for all of them."""
    for bad in (torch.nan, -1.0):
        factor = torch.tensor([1.0, bad], dtype=F64)[:, None, None, None, None]
        bowl = Bowl(lambda e, by=factor: replace(e, curvature=by * e.curvature))
        found = solve(Objective(bowl=bowl), start(2))
        assert found.status.tolist() == [Status.CONVERGED, Status.NOT_FINITE]
        assert float(found.energy[0]) < 1e-9


@pytest.mark.parametrize(
    "change",
    [
        lambda e: replace(e, value=e.value.sum()),
        lambda e: replace(e, gradient=e.gradient[:1]),
        lambda e: replace(e, curvature=e.curvature[:2]),
        lambda e: replace(e, gradient=e.gradient.float()),
    ],
)
def test_expansions_of_other_points(change) -> None:
    """They were those of the first frame, in all."""
    with pytest.raises(InputError, match=r"Bowl.expand returned"):
        solve(Objective(bowl=Bowl(change)), start())


# --- States and bounds ----------------------------------------------------------------------------


class InPlace(Energy[Frames]):
    """Moves the state that it is asked about."""

    def residual(self, state):
        state.frame.add_(0.1)
        return Residual((state.frame - 1).unsqueeze(-1))


def test_a_state_that_is_changed_in_place() -> None:
    """The answer was off by as much."""
    with pytest.raises(InputError, match="energy 'data' changes its state in place"):
        solve(Objective(data=InPlace()), start())


def test_residuals_of_arrays() -> None:
    class Array(Energy[Frames]):
        def residual(self, state):
            return Residual([1.0])

    for method in (LevenbergMarquardt(), Adam()):
        with pytest.raises(InputError, match="returned a Residual of a list"):
            solve(Objective(data=Array()), start(), method)


def test_bounds_of_integers() -> None:
    """They ended in a traceback."""
    with pytest.raises(InputError, match=r"bounds are torch.int64 .* expected floating-point"):
        Bounds.on_frames(-torch.ones(3).long(), torch.ones(3).long())
