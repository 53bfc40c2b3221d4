"""Linearizations by blocks, and the products that conjugate gradients are made of."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
import torch
from block_toy import Blocks, StiffChain, block_toy, dense
from toy import toy

from perfcap.errors import InputError
from perfcap.geometry import torch_only
from perfcap.solve import Bounds, GemanMcClure, Objective, TruncatedNewton, solve
from perfcap.solve import _blocks_torch as plain
from perfcap.solve._blocks_numba import BlockCurvature
from perfcap.solve.coarse import coarse_correction
from perfcap.solve.coarse_space import CoarseSpace, aggregate
from perfcap.solve.conjugate_gradient import conjugate_gradients
from perfcap.solve.sparse_problem import SparseProblem


def curvatures(objective, state):
    """Compiled and plain curvature of every energy."""
    for energy in objective.energies.values():
        linear = energy.linearize_blocks(state)
        value, jacobian = linear.residual.value, linear.jacobian
        weight = torch.linspace(0, 1, value.shape[-2], dtype=value.dtype).expand(value.shape[:-1])
        parts = (
            linear.blocks.flatten(0, -3),
            jacobian.flatten(0, -5),
            value.flatten(0, -3),
            weight.flatten(0, -2),
        )
        yield BlockCurvature.of(*parts), plain.BlockCurvature(*parts)


@pytest.mark.parametrize("repeat", [True, False])
def test_equations_are_the_dense_ones(repeat):
    objective, state = block_toy(batch=(2,), kernel=GemanMcClure(0.8), repeat=repeat)
    equations = SparseProblem.of(objective, state).linearize(state)
    gradient, matrix = dense(objective, state)
    torch.testing.assert_close(equations.gradient.flatten(1), gradient)
    whole = matrix.unflatten(-1, (9, 2)).unflatten(-3, (9, 2))
    blocks = whole.diagonal(dim1=1, dim2=3).permute(0, 3, 1, 2)
    if not repeat:
        torch.testing.assert_close(equations.diagonal, blocks.tril())
    direction = torch.randn(6, 9, 2, dtype=torch.float64)
    product = torch.zeros_like(direction)
    for curvature in equations.curvatures:
        curvature.add_product(direction, product, torch.ones(6, dtype=torch.bool))
    expected = (matrix @ direction.flatten(1).unsqueeze(-1)).squeeze(-1)
    torch.testing.assert_close(product.flatten(1), expected)
    torch.testing.assert_close(equations.energy.reshape(2, 3).sum(-1), objective(state))


def test_compiled_curvatures_equal_plain_ones():
    objective, state = block_toy(frames=2)
    random = torch.Generator().manual_seed(3)
    direction = torch.randn(2, 9, 2, generator=random, dtype=torch.float64)
    modes = torch.randn(2, 9, 2, 3, generator=random, dtype=torch.float64)
    group = torch.tensor([0, 0, 1, -1, 1, 2, 2, 2, 0])
    for pair in curvatures(objective, state):
        results = []
        for curvature in pair:
            gradient, product = torch.zeros(2, 2, 9, 2, dtype=torch.float64)
            diagonal = direction.new_zeros(2, 9, 2, 2)
            coarse = direction.new_zeros(2, 3, 3, 3, 3)
            curvature.add_equations(gradient, diagonal)
            curvature.add_product(direction, product, torch.ones(2, dtype=torch.bool))
            curvature.add_coarse(CoarseSpace(group, 3, modes), coarse)
            results.append((gradient, diagonal, product, coarse))
        torch.testing.assert_close(*results, rtol=1e-10, atol=1e-12)
        assert all(bool(part.any()) for part in results[0])


def test_coarse_matrix_is_the_restricted_one():
    objective, state = block_toy(frames=1)
    _, matrix = dense(objective, state)
    group = torch.tensor([0, 0, 1, -1, 1, 2, 2, 2, 0])
    modes = torch.randn(1, 9, 2, 2, dtype=torch.float64)
    spread = torch.zeros(9, 2, 3, 2, dtype=torch.float64)  # M q C r
    for block, own in enumerate(group.tolist()):
        if own >= 0:
            spread[block, :, own] = modes[0, block]
    basis = spread.reshape(18, 6)
    found = torch.zeros(1, 3, 2, 3, 2, dtype=torch.float64)
    for curvature in SparseProblem.of(objective, state).linearize(state).curvatures:
        curvature.add_coarse(CoarseSpace(group, 3, modes), found)
    expected = basis.T @ matrix[0] @ basis
    torch.testing.assert_close(found.reshape(6, 6).tril(), expected.tril())


@pytest.mark.parametrize("kernels", [nullcontext, torch_only])
@pytest.mark.parametrize("kind", [None, StiffChain])
def test_conjugate_gradients_solve_the_damped_equations(kernels, kind):
    with kernels():
        objective, state = block_toy(chain=kind) if kind else block_toy()
        equations = SparseProblem.of(objective, state).linearize(state)
        damping = torch.full_like(equations.gradient, 1e-3)
        correction = None
        if kind is not None:
            space = objective.energies["chain"].coarse_space(state)
            correction = coarse_correction(space, equations, damping)
        running = torch.tensor([True, False, True])
        descent = conjugate_gradients(
            equations, damping, running, torch.zeros(3).double(), 1e-12, 60, correction
        )
    gradient, matrix = dense(objective, state)
    damped = matrix + 1e-3 * torch.eye(18, dtype=torch.float64)
    expected = torch.linalg.solve(damped, -gradient)
    step = descent.step.flatten(1)
    torch.testing.assert_close(step[running], expected[running], rtol=0, atol=1e-9)
    assert not step[1].any()
    assert descent.rounds[1] == 0
    curved = (step.unsqueeze(-2) @ matrix @ step.unsqueeze(-1)).flatten()
    torch.testing.assert_close(descent.promised, -2 * (gradient * step).sum(-1) - curved)


def test_a_coarse_space_saves_rounds():
    objective, state = block_toy(frames=2, blocks=120, groups=8, chain=StiffChain)
    objective.energies["sight"].weight *= 1e-3
    objective.energies["chain"].bend = 0.0  # so that groups move as one at no cost
    equations = SparseProblem.of(objective, state).linearize(state)
    damping = 1e-9 * equations.diagonal.diagonal(dim1=-2, dim2=-1)
    space = objective.energies["chain"].coarse_space(state)
    correction = coarse_correction(space, equations, damping)
    running = torch.ones(2, dtype=torch.bool)
    rounds = [
        conjugate_gradients(
            equations, damping, running, torch.zeros(2).double(), 1e-6, 1000, second
        ).rounds
        for second in (None, correction)
    ]
    assert (rounds[1] < 0.5 * rounds[0]).all()


def test_groups_are_connected_and_even():
    side = 12
    grid = np.arange(side * side).reshape(side, side)
    pairs = np.concatenate(
        [np.stack((grid[:, 1:].ravel(), grid[:, :-1].ravel()), 1),
         np.stack((grid[1:].ravel(), grid[:-1].ravel()), 1)]
    )  # fmt: skip
    edges = np.concatenate((pairs, pairs[:, ::-1]))
    group, count = aggregate(edges, side * side + 2, 12)  # and two nodes by themselves
    assert count == 12
    sizes = np.bincount(group, minlength=count)
    assert sizes.sum() == side * side + 2
    assert sizes[group[-1]] == sizes[group[-2]] == 1
    assert np.sort(sizes)[2] >= 4 and sizes.max() <= 30
    for own in range(count):
        inside = edges[(group[edges] == own).all(-1)]
        reached = group == own
        reached[np.flatnonzero(reached)[1:]] = False
        for _ in range(sizes.max()):
            reached[inside[reached[inside[:, 0]], 1]] = True
        assert reached.sum() == sizes[own]


def test_what_has_no_blocks_is_refused():
    objective, state = block_toy()
    box = Bounds(state.coordinates(), state.coordinates())
    with pytest.raises(InputError, match="bounds"):
        solve(objective, state, TruncatedNewton(), box)
    dense_objective, frames = toy(windows=1)
    with pytest.raises(InputError, match="no block_dim"):
        solve(dense_objective, frames, TruncatedNewton())
    with pytest.raises(InputError, match=r"'data'.*no linearize_blocks"):
        solve(Objective(data=dense_objective.energies["data"]), state, TruncatedNewton())

    class Shared(Blocks):
        @property
        def shared_sizes(self) -> dict[str, int]:
            return {"all": 2}

    with pytest.raises(InputError, match="2 unknowns that frames share"):
        TruncatedNewton().minimize(objective, Shared(state.values), None)
