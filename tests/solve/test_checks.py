"""The energy check itself: it passes what is right and names what is wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from checks import check_energy
from toy import Frames, Observation, Product, Smoothness, cosine_basis, toy

from perfcap.solve import Energy, GemanMcClure, Huber, Quadratic, Residual


@pytest.mark.parametrize("kernel", [Quadratic(), Huber(0.4), GemanMcClure(0.5)])
@pytest.mark.parametrize("name", ["data", "smooth", "product"])
def test_toy_energies_pass(name, kernel):
    objective, state = toy(batch=(2,), windows=2, shared=2, kernel=kernel)
    energy = objective.energies[name]

    def pick(index):
        alone = Frames(state.frame[index], state.shared[index])
        if name != "data":
            return energy, alone
        parts = energy.matrix[index], energy.target[index], energy.confidence[index]
        return Observation(*parts, energy.weight, energy.kernel, shared=True), alone

    check_energy(energy, state, pick=pick)


def test_gradient_reaches_inputs():
    objective, state = toy(windows=0)
    target = objective.energies["data"].target.requires_grad_()
    check_energy(objective.energies["data"], state, inputs=[target])
    with pytest.raises(AssertionError, match="reaches input 0"):
        check_energy(objective.energies["data"], state, inputs=[torch.ones(1, requires_grad=True)])


def test_wrong_jacobian_entry_is_named():
    class Wrong(Observation):
        def linearize(self, state):
            linear = super().linearize(state)
            linear.frame[4, 1, 0, 2] += 0.01
            return linear

    data = toy(windows=0)[0].energies["data"]
    wrong = Wrong(data.matrix, data.target, data.confidence)
    with pytest.raises(AssertionError, match=r"Wrong: .*= \[4, 1, 0\] in unknown 2 is"):
        check_energy(wrong, toy(windows=0)[1])


def test_wrong_feature_jacobian_is_named():
    class Wrong(Product):
        def linearize_features(self, state):
            features, jacobian = super().linearize_features(state)
            return features, jacobian * 1.1

    wrong = Wrong(cosine_basis(2, 7), torch.ones(2, dtype=torch.float64))
    with pytest.raises(AssertionError, match="Wrong: derivative of row"):
        check_energy(wrong, toy(windows=0)[1])


def test_hidden_coupling_is_found():
    class Velocity(Energy):
        def residual(self, state):
            return Residual((state.frame - state.frame.roll(1, -2)).unsqueeze(-2))

    with pytest.raises(AssertionError, match="rows of frame 1 change when frame 0 moves"):
        check_energy(Velocity(), toy()[1])


def test_hidden_shared_unknowns_are_found():
    class Hidden(Energy):
        def residual(self, state):
            return Residual((state.frame * state.shared.sum(-1)[..., None, None]).unsqueeze(-2))

    with pytest.raises(AssertionError, match="does not name them in sees"):
        check_energy(Hidden(), toy(shared=1)[1])


def test_wrong_shapes_and_values_are_found():
    class Flat(Energy):
        def residual(self, state):
            return Residual(state.frame)

    class Halved(Observation):
        def forward(self, state):
            return 0.5 * super().forward(state)

    with pytest.raises(AssertionError, match="residual has shape"):
        check_energy(Flat(), toy()[1])
    data = toy(windows=0)[0].energies["data"]
    with pytest.raises(AssertionError, match=r"forward.state. is wrong"):
        check_energy(Halved(data.matrix, data.target), toy(windows=0)[1])


def test_mixed_up_batch_is_found():
    objective, state = toy(batch=(2,), windows=1)
    smooth: Smoothness = objective.energies["smooth"]
    swapped = replace(state, frame=state.frame.flip(0))
    with pytest.raises(AssertionError, match="batch element 0"):
        check_energy(
            smooth, state, pick=lambda i: (smooth, Frames(swapped.frame[i], state.shared[i]))
        )
