"""Recovery, robustness and batches of the truncated method."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from block_toy import Blocks, Chain, Sight, StiffChain, block_toy

from perfcap.geometry import torch_only
from perfcap.solve import (
    Energy,
    GemanMcClure,
    LevenbergMarquardt,
    Objective,
    Residual,
    Status,
    TruncatedNewton,
    solve,
)
from perfcap.solve.sparse import BlockLinearization
from perfcap.solve.sparse_problem import SparseProblem

STRICT = TruncatedNewton(max_steps=100, tolerance=0.0, forcing=1e-4)


@pytest.mark.parametrize("chain", [Chain, StiffChain])
@pytest.mark.parametrize("kernel", [None, GemanMcClure(1.0)])
def test_minimum_is_that_of_the_dense_method(chain, kernel):
    objective, state = block_toy(frames=1, kernel=kernel, chain=chain)
    sparse = solve(objective, state, STRICT)
    exact = solve(objective, state, LevenbergMarquardt(max_steps=300, tolerance=1e-15))
    assert (sparse.status == Status.CONVERGED).all(), sparse.describe()
    torch.testing.assert_close(sparse.state.values, exact.state.values, rtol=0, atol=1e-8)
    assert sparse.energy.item() == pytest.approx(exact.energy.item(), rel=1e-12)


def test_every_frame_is_a_problem_of_its_own():
    objective, state = block_toy(batch=(2,), frames=4)
    together = solve(objective, state, STRICT)
    assert together.energy.shape == together.steps.shape == together.status.shape == (2, 4)
    assert all(term.shape == (2, 4) for term in together.terms.values())
    torch.testing.assert_close(together.energy.sum(-1), objective(together.state))
    chain, sight = objective.energies["chain"], objective.energies["sight"]
    for place in [(0, 0), (0, 3), (1, 2)]:
        index = (place[0], slice(place[1], place[1] + 1))
        own = Objective(
            chain=Chain(chain.target[index], chain.weight),
            sight=Sight(
                sight.blocks[index],
                sight.rows[index],
                sight.target[index],
                sight.confidence[index],
                sight.weight,
            ),
        )
        alone = solve(own, Blocks(state.values[index]), STRICT)
        assert together.steps[place] == alone.steps
        torch.testing.assert_close(
            together.state.values[index], alone.state.values, rtol=0, atol=1e-12
        )


def test_one_bad_frame_never_touches_the_others():
    objective, state = block_toy(frames=3, chain=StiffChain)
    good = solve(objective, state, STRICT)
    objective.energies["chain"].target[1, 2, 0] = torch.nan
    mixed = solve(objective, state, STRICT)
    assert mixed.status.tolist() == [Status.CONVERGED, Status.NOT_FINITE, Status.CONVERGED]
    for frame in (0, 2):
        torch.testing.assert_close(
            mixed.state.values[frame], good.state.values[frame], rtol=0, atol=1e-12
        )
    assert torch.equal(mixed.state.values[1], state.values[1])
    assert mixed.energy[1].isnan()
    assert mixed.steps[1] == 0


def test_a_state_that_is_not_finite_is_returned():
    objective, state = block_toy()
    state.values[0, 3, 1] = torch.nan
    solution = solve(objective, state, TruncatedNewton())
    assert solution.status[0] == Status.NOT_FINITE
    assert solution.state.values[0, 3, 1].isnan()
    assert solution.state.values[1:].isfinite().all()


def test_an_energy_that_breaks_on_the_way_keeps_the_last_finite_state():
    class Wall(Energy[Blocks]):
        """Not a number beyond 0.5, where the gradient leads."""

        def residual(self, state):
            x = state.values
            return Residual(x - 1 + 0 * (0.5 - x).sqrt())

        def linearize_blocks(self, state):
            x = state.values
            blocks = torch.arange(x.shape[-2]).expand(x.shape[:-1]).unsqueeze(-1)
            eye = torch.eye(x.shape[-1], dtype=x.dtype).expand(*x.shape[:-1], 1, -1, -1)
            return BlockLinearization(self.residual(state), blocks, eye)

    start = Blocks(torch.zeros(3, 4, 2, dtype=torch.float64))
    solution = solve(Objective(wall=Wall()), start, TruncatedNewton(max_steps=60))
    assert (solution.status != Status.CONVERGED).all()
    assert solution.state.values.isfinite().all()
    assert (solution.energy.isfinite() & (solution.energy <= 8)).all()


def test_twice_is_the_same():
    objective, state = block_toy(batch=(2,), chain=StiffChain)
    first, second = (solve(objective, state, TruncatedNewton()) for _ in range(2))
    assert torch.equal(first.state.values, second.state.values)
    assert torch.equal(first.energy, second.energy)


def test_plain_torch_takes_the_same_way():
    objective, state = block_toy(frames=2, chain=StiffChain)
    compiled = solve(objective, state, STRICT)
    with torch_only():
        plain = solve(objective, state, STRICT)
    assert torch.equal(plain.steps, compiled.steps)
    torch.testing.assert_close(plain.state.values, compiled.state.values, rtol=0, atol=1e-8)


@pytest.mark.long
def test_float32_stops_by_its_own_rule():
    objective, state = block_toy(chain=StiffChain)
    exact = solve(objective, state, STRICT)
    single = solve(objective.float(), Blocks(state.values.float()), STRICT)
    assert (single.status == Status.CONVERGED).all(), single.describe()
    torch.testing.assert_close(single.energy.double(), exact.energy, rtol=1e-4, atol=1e-6)


def test_a_block_that_nothing_sees_stays():
    state = Blocks(torch.randn(2, 5, 2, dtype=torch.float64))
    seen = torch.tensor([[[0, 1, 3]] * 4] * 2)
    energy = Sight(
        seen, torch.randn(2, 4, 3, 2, dtype=torch.float64), torch.zeros(2, 4, dtype=torch.float64)
    )
    solution = solve(Objective(sight=energy), state, STRICT)
    assert (solution.energy < 1e-12).all()
    for unseen in (2, 4):
        assert torch.equal(solution.state.values[:, unseen], state.values[:, unseen])


def test_unknowns_that_nothing_sees_stay():
    """As rotations do where only translations are seen."""
    state = Blocks(torch.randn(2, 3, 2, dtype=torch.float64))
    rows = torch.randn(2, 2, 3, 2, dtype=torch.float64)
    rows[..., 1] = 0
    seen = torch.arange(3).expand(2, 2, 3)
    target = torch.zeros(2, 2, dtype=torch.float64)
    solution = solve(Objective(sight=Sight(seen, rows, target)), state, STRICT)
    assert (solution.energy < 1e-12).all()
    assert torch.equal(solution.state.values[..., 1], state.values[..., 1])


def test_steps_end_the_solve_and_are_counted():
    objective, state = block_toy()
    solution = solve(objective, state, replace(STRICT, max_steps=1))
    assert solution.steps.tolist() == [1, 1, 1]
    assert solution.status.tolist() == [Status.MAX_STEPS] * 3


def test_a_wrong_jacobian_stalls():
    class Reversed(Chain):
        def linearize_blocks(self, state):
            linear = super().linearize_blocks(state)
            return replace(linear, jacobian=-linear.jacobian)

    target = torch.ones(2, 8, 2, dtype=torch.float64)
    start = Blocks(torch.zeros(2, 9, 2, dtype=torch.float64))
    solution = solve(Objective(chain=Reversed(target)), start, TruncatedNewton(max_steps=60))
    assert (solution.status == Status.STALLED).all()


def test_gradient_vanishes_at_the_end():
    objective, state = block_toy(batch=(2,))
    solution = solve(objective, state, STRICT)
    problem = SparseProblem.of(objective, state)
    there, here = (problem.linearize(s).gradient for s in (solution.state, state))
    assert there.abs().max() < 1e-6 * here.abs().max()
