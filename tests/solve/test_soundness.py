"""Energies of one's own that are not what automatic derivatives assume are refused by name."""

from __future__ import annotations

import pytest
import torch
from toy import Frames, Smoothness, cosine_basis

from perfcap.errors import InputError
from perfcap.solve import (
    Adam,
    Compound,
    Energy,
    Implicit,
    LevenbergMarquardt,
    Objective,
    Residual,
    Unrolled,
    of_part,
    solve,
)

pytestmark = pytest.mark.usefixtures("both_twins")
F64 = torch.float64


class Own(Energy):
    """Whatever a function says of a state."""

    def __init__(self, function, weight=1.0, sees=()):
        super().__init__(weight)
        self.function, self.sees = function, sees

    def residual(self, state):
        return self.function(state)


def start(*lead: int, shared: int = 0) -> Frames:
    generator = torch.Generator().manual_seed(3)
    lead = lead or (2, 7)
    frame = torch.rand(*lead, 3, generator=generator, dtype=F64)
    return Frames(frame, torch.zeros(*lead[:-1], shared, dtype=F64))


def rows(value, confidence=None) -> Residual:
    return Residual(value.unsqueeze(-2), confidence)


def padded(difference, lag):
    zero = torch.zeros_like(difference[..., :lag, :])
    return torch.cat((difference, zero), -2)


COUPLED = {
    "the next frame": lambda s: rows(padded(s.frame[..., 1:, :] - s.frame[..., :-1, :], 1)),
    "two frames on": lambda s: rows(padded(s.frame[..., 2:, :] - s.frame[..., :-2, :], 2)),
    "the frame before": lambda s: rows(s.frame - s.frame.roll(1, -2)),
    "the mean over time": lambda s: rows(s.frame - s.frame.mean(-2, keepdim=True)),
    "the batch": lambda s: rows(s.frame - s.frame.mean(0)),
}


@pytest.mark.parametrize("method", [LevenbergMarquardt(), None])
@pytest.mark.parametrize("what", COUPLED)
def test_rows_that_depend_on_other_frames_are_refused(what, method):
    objective = Objective(smooth=Own(COUPLED[what]))
    with pytest.raises(InputError, match="energy 'smooth' has rows that depend on other frames"):
        solve(objective, start(), method)
    with pytest.raises(InputError, match="'smooth'"):
        solve(objective, start(), method, adjoint=Unrolled())


def test_rows_of_a_part_are_looked_at_too():
    state = Compound({"body": start(), "rest": start()})
    for what in COUPLED.values():
        with pytest.raises(InputError, match="energy 'smooth' has rows that depend on other"):
            solve(Objective(smooth=of_part("body", Own(what))), state)
    found = solve(Objective(own=of_part("body", Own(lambda s: rows(s.frame)))), state)
    assert (found.energy < 1e-9).all()


def test_first_order_descent_takes_them():
    energy = Own(COUPLED["the frame before"])
    found = solve(Objective(smooth=energy), start(), Adam(max_steps=20))
    assert (found.energy < energy(start())).all()


@pytest.mark.parametrize("lead", [(7,), (1,), (2, 1), (1, 2), (3, 2, 5)])
def test_rows_of_frames_of_their_own_pass(lead):
    state = start(*lead)
    target = state.frame.flip(-1)
    # a statistic of all frames that is held constant has no derivative to go wrong
    energy = Own(lambda s: rows(s.frame - target + 0 * s.frame.detach().mean(-2, keepdim=True)))
    found = solve(Objective(own=energy), state, adjoint=Implicit())
    torch.testing.assert_close(found.state.frame, target, rtol=0, atol=1e-6)


WRONG = {
    "confidences below zero": lambda s: rows(s.frame, -torch.ones_like(s.frame[..., :1])),
    r"returned a Tensor": lambda s: s.frame,
    r"returned values \(2, 7, 3\)": lambda s: Residual(s.frame),
    r"returned values \(2, 6, 1, 3\)": lambda s: rows(s.frame.diff(dim=-2)),
    r"returned torch.float32": lambda s: rows(s.frame.float()),
    r"confidence \(2, 7, 1, 1\)": lambda s: rows(s.frame, torch.ones(2, 7, 1, 1, dtype=F64)),
}


@pytest.mark.parametrize("message", WRONG)
def test_residuals_that_are_none_are_refused(message):
    with pytest.raises(InputError, match=f"energy 'own' .*{message}"):
        solve(Objective(own=Own(WRONG[message])), start())


def test_confidences_may_broadcast_and_be_bool():
    on = torch.tensor([True, False, True, True, True, True, True]).unsqueeze(-1)
    found = solve(Objective(own=Own(lambda s: rows(s.frame, on))), start())
    assert (found.state.frame[:, 0].abs() < 1e-6).all()


def test_shared_unknowns_that_are_not_named_are_refused():
    def pull(state):
        return rows(state.frame + state.shared.unsqueeze(-2))

    state = start(shared=3)
    with pytest.raises(InputError, match=r"energy 'own' depends on shared unknowns .* all, in its"):
        solve(Objective(own=Own(pull)), state)
    found = solve(Objective(own=Own(pull, sees=("all",))), state)
    assert (found.energy < 1e-6).all()


def test_a_learned_weight_below_zero_is_refused():
    weight = torch.nn.Parameter(torch.tensor(0.1, dtype=F64))
    objective = Objective(own=Own(lambda s: rows(s.frame), weight))
    solve(objective, start())
    with torch.no_grad():
        weight -= 1
    with pytest.raises(InputError, match=r"energy 'own' has a weight of -0\.9"):
        solve(objective, start())
    with pytest.raises(InputError, match="weight is"):
        Own(lambda s: rows(s.frame), weight.detach())


def test_filters_of_other_frames_are_refused():
    filters = Smoothness(cosine_basis(2, 9), torch.ones(2, dtype=F64), torch.ones(4, dtype=F64))
    with pytest.raises(InputError, match="energy 'smooth' filters 9 frames but the state has 7"):
        solve(Objective(own=Own(lambda s: rows(s.frame)), smooth=filters), start())


WRONG_FOR_ADAM = {
    "expected a Residual": lambda s: s.frame.unsqueeze(-2),
    "rows of G groups": lambda s: Residual(s.frame),
    "and confidence": lambda s: rows(s.frame, s.frame.new_ones(2)),
    "confidences below zero": lambda s: rows(s.frame, -s.frame.new_ones(1)),
}


@pytest.mark.parametrize("message", WRONG_FOR_ADAM)
def test_first_order_descent_refuses_residuals_that_are_none(message):
    objective = Objective(own=Own(WRONG_FOR_ADAM[message]))
    with pytest.raises(InputError, match=message):
        solve(objective, start(), Adam(max_steps=2))


def test_first_order_descent_warns_of_constants():
    objective = Objective(own=Own(lambda s: rows(s.frame.detach() + 1)))
    with pytest.warns(UserWarning, match="does not change with its unknowns"):
        found = solve(objective, start(), Adam(max_steps=2))
    assert torch.equal(found.state.frame, start().frame)


@pytest.mark.parametrize("method", [Adam(max_steps=2), None])
def test_inference_mode_is_refused_where_derivatives_are_recorded(method):
    target = torch.ones(3, dtype=F64)
    with torch.inference_mode(), pytest.raises(InputError, match=r"use torch\.no_grad"):
        solve(lambda x: x - target, torch.zeros(3, dtype=F64), method)
    with torch.inference_mode(), pytest.raises(InputError, match=r"use torch\.no_grad"):
        solve(Objective(own=Own(lambda s: rows(s.frame))), start(), Adam(max_steps=2))


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_first_order_descent_takes_as_many_steps_as_it_may(steps):
    energy = Own(COUPLED["the frame before"])
    found = solve(Objective(smooth=energy), start(), Adam(max_steps=steps))
    assert (found.steps == steps).all()
