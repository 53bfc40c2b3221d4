"""States, energies and objectives."""

from __future__ import annotations

import pytest
import torch
from toy import Frames, Observation, Product, Smoothness, cosine_basis, toy

from perfcap.errors import InputError
from perfcap.solve import (
    Energy,
    Huber,
    Objective,
    Residual,
    ResidualFunction,
    Step,
    forward_mode,
)


def test_forward_mode_equals_reverse_mode():
    objective, state = toy(batch=(2,), shared=2, windows=0)
    linear = forward_mode(objective.energies["data"], state)

    def residual(frame, shared):
        return objective.energies["data"].residual(Frames(frame, shared)).value

    frame, shared = torch.func.jacrev(residual, argnums=(0, 1))(state.frame, state.shared)
    for b in range(2):
        for f in range(7):
            torch.testing.assert_close(linear.frame[b, f], frame[b, f, :, :, b, f])
            torch.testing.assert_close(linear.shared[b, f], shared[b, f, :, :, b])
    assert torch.equal(linear.residual.confidence, objective.energies["data"].confidence)


def test_forward_mode_evaluates_the_residual_once():
    class Counted(Observation):
        calls = 0

        def residual(self, state):
            self.calls += 1
            return super().residual(state)

    data = toy(windows=0)[0].energies["data"]
    counted = Counted(data.matrix, data.target, data.confidence)
    linear = counted.linearize(toy(windows=0)[1])
    assert counted.calls == 1
    assert linear.shared is None


def test_feature_jacobian_equals_reverse_mode():
    objective, state = toy(windows=1)
    smooth = objective.energies["smooth"]
    features, jacobian = smooth.linearize_features(state)
    expected = torch.func.jacrev(lambda x: smooth.features(Frames(x, state.shared)))(state.frame)
    torch.testing.assert_close(features, smooth.features(state))
    torch.testing.assert_close(jacobian, torch.stack([expected[f, :, f] for f in range(7)]))


def test_filter_removes_what_is_kept_free():
    basis = cosine_basis(3, 7)
    smooth = Smoothness(basis, torch.tensor([1.0, 1.0, 0.5]).double(), torch.ones(4))
    features = basis.mT @ torch.randn(3, 5, dtype=torch.float64)
    expected = 0.5 * basis[2:].mT @ (basis[2:] @ features)
    torch.testing.assert_close(smooth.filter(features), expected)


def test_objective_is_the_sum_of_its_report():
    objective, state = toy(batch=(3,), windows=2, shared=1)
    report = objective.report(state)
    assert list(report) == ["data", "prior", "smooth", "product"]
    torch.testing.assert_close(objective(state), sum(report.values()))


def test_weight_keeps_its_digits_and_never_promotes():
    class Plain(Energy):
        def residual(self, state):
            return Residual(state.frame.unsqueeze(-2))

    state = toy()[1]
    energy = Plain(0.1)
    assert energy(state).item() == pytest.approx(0.1 * state.frame.square().sum().item(), rel=1e-14)
    assert energy(state.to(torch.float32)).dtype == torch.float32
    learned = Plain(torch.nn.Parameter(torch.tensor(2.0)))
    assert [name for name, _ in learned.named_parameters()] == ["weight"]


def test_zero_step_is_the_identity():
    _, state = toy(shared=2)
    moved = state.retract(Step(0 * state.frame, 0 * state.shared))
    assert torch.equal(moved.frame, state.frame)
    assert torch.equal(state.local(moved).shared, 0 * state.shared)


def test_objective_without_energies_is_refused():
    with pytest.raises(InputError, match="at least one energy"):
        Objective()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda own: Objective({"data": own}, data=own), "got a name twice"),
        (lambda own: Objective({"a.b": own}), "'a.b' cannot name an energy"),
        (lambda own: Objective({"": own}), "'' cannot name"),
        (lambda own: Objective(items=own), "'items' cannot name"),
        (lambda own: Objective(data=lambda state: state.frame), "'data' is a function"),
        (lambda own: Objective(data=torch.nn.Linear(1, 1)), "'data' is a Linear"),
    ],
)
def test_objectives_of_something_else_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make(toy(windows=0)[0].energies["data"])


@pytest.mark.parametrize(
    ("weight", "kernel", "message"),
    [
        (-1.0, None, "weight is -1.0"),
        (torch.tensor(-1.0), None, r"weight is tensor\(-1"),
        (torch.tensor([1.0, float("nan")]), None, "weight is tensor"),
        (Huber(0.1), None, "weight is Huber"),
        (1.0, Huber, "kernel is <class"),
        (1.0, 0.1, "kernel is 0.1"),
    ],
)
def test_weights_and_kernels_that_are_none_are_named(weight, kernel, message):
    with pytest.raises(InputError, match=message):
        ResidualFunction(torch.sin, weight, kernel)


@pytest.mark.parametrize(
    ("basis", "keep", "message"),
    [
        (torch.ones(2, 7), torch.ones(2), "off orthonormal by 7"),
        (torch.eye(7), torch.full((7,), 1.5), "expected values in"),
        (torch.eye(7), torch.ones(6), r"expected \(K, F\) and \(K,\)"),
    ],
)
def test_unfit_filters_are_named(basis, keep, message):
    with pytest.raises(InputError, match=message):
        Product(basis, keep)


def test_window_energies_have_no_blocks():
    objective, state = toy()
    with pytest.raises(TypeError, match="use linearize_features"):
        objective.energies["smooth"].linearize(state)
