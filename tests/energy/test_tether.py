"""Graph nodes tied to where they were."""

from __future__ import annotations

import pytest
import torch
from checks import check_energy

from perfcap.actor.deformation import Deformation
from perfcap.energy.tether import Tether
from perfcap.errors import InputError
from perfcap.solve import Objective, TruncatedNewton, solve

SHAPE = (2, 3, 5, 3)  # batch, frames, nodes


def deformation() -> Deformation:
    random = torch.Generator().manual_seed(0)
    parts = torch.randn(2, *SHAPE, generator=random, dtype=torch.float64)
    return Deformation(0.3 * parts[0], 0.1 * parts[1])


def test_value_is_the_mean_over_nodes() -> None:
    state = deformation()
    value = Tether(5, weight=2.0, unit=0.1)(state)
    expected = 2.0 * (state.translation / 0.1).square().sum(-1).mean(-1).sum(-1)
    torch.testing.assert_close(value, expected)


def test_blocks_are_the_derivative() -> None:
    state = deformation()
    check_energy(Tether(5, unit=0.1), state)
    linear = Tether(5, unit=0.1).linearize_blocks(state)
    moved = state.retract(state.local(Deformation(state.rotation, 2 * state.translation)))
    change = torch.einsum(
        "...kdq,...q->...d",
        linear.jacobian,
        torch.cat((torch.zeros(SHAPE, dtype=torch.float64), state.translation), -1),
    )
    torch.testing.assert_close(
        Tether(5, unit=0.1).residual(moved).value, linear.residual.value + change
    )


def test_alone_it_brings_nodes_home() -> None:
    method = TruncatedNewton(max_steps=50, tolerance=1e-12)
    solution = solve(Objective(tether=Tether(5, unit=0.1)), deformation(), method)
    assert solution.state.translation.abs().max() < 1e-5


def test_another_number_of_nodes_is_refused() -> None:
    """The mean was over as many as were said."""
    with pytest.raises(InputError, match="made for 7 nodes but the deformation has 5"):
        Tether(7)(deformation())
