"""The structured equations against their dense twins."""

from __future__ import annotations

import pytest
import torch
from toy import Frames, Smoothness, cosine_basis, dense_derivatives, toy

from perfcap.errors import InputError
from perfcap.solve import Coupling, Energy, GemanMcClure, Objective, Residual, WindowEnergy
from perfcap.solve.assembly import assemble
from perfcap.solve.box_step import InverseColumns
from perfcap.solve.energy_checks import require_slopes
from perfcap.solve.factorization import factorize

KINDS = {
    "frames only": {"windows": 0},
    "one window": {"windows": 1},
    "two windows": {"windows": 2},
    "shared": {"windows": 0, "shared": 2},
    "everything": {"windows": 2, "shared": 3},
    "robust": {"windows": 1, "kernel": GemanMcClure(0.5)},
    "weak data": {"windows": 2, "data": 1e-6, "shared": 1},
}


@pytest.mark.parametrize("kind", KINDS)
def test_model_equals_dense_twin(kind):
    objective, state = toy(**KINDS[kind])
    equations = assemble(objective, state)
    gradient, matrix = dense_derivatives(objective, state)
    identity = torch.eye(len(gradient), dtype=torch.float64)
    applied = torch.cat([equations.apply(row[None]) for row in identity])
    torch.testing.assert_close(equations.gradient()[0], gradient, rtol=1e-12, atol=1e-14)
    torch.testing.assert_close(applied, matrix, rtol=1e-12, atol=1e-14)
    torch.testing.assert_close(equations.energy[0], objective(state), rtol=1e-13, atol=0)


@pytest.mark.parametrize("kind", KINDS)
def test_promised_decrease_is_the_quadratic_model(kind):
    objective, state = toy(**KINDS[kind])
    gradient, matrix = dense_derivatives(objective, state)
    step = 0.1 * torch.randn(len(gradient), generator=torch.Generator().manual_seed(1)).double()
    expected = -(2 * gradient @ step + step @ matrix @ step)
    torch.testing.assert_close(assemble(objective, state).decrease(step[None])[0], expected)


@pytest.mark.parametrize("kind", KINDS)
def test_solves_leave_no_residual(kind):
    objective, state = toy(**KINDS[kind])
    gradient, matrix = dense_derivatives(objective, state)
    damping = 1e-4 * KINDS[kind].get("data", 1.0) * torch.ones_like(gradient)
    matrix = matrix + damping.diag()
    factorization = factorize(assemble(objective, state), damping[None])
    right = torch.randn(len(gradient), generator=torch.Generator().manual_seed(1)).double()
    solved = factorization.solve(right[None])[0]
    residual = matrix @ solved - right
    newton = matrix @ factorization.newton_step(assemble(objective, state))[0] + gradient
    assert residual.norm() < 1e-14 * matrix.norm() * solved.norm()
    assert newton.norm() < 1e-14 * gradient.norm()


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "weak data"])
def test_inverse_block_is_a_block_of_the_inverse(kind):
    objective, state = toy(**KINDS[kind])
    gradient, matrix = dense_derivatives(objective, state)
    damping = torch.full_like(gradient, 1e-3)
    factorization = factorize(assemble(objective, state), damping[None])
    index = torch.tensor([[0, 1, 5, 17, 27, len(gradient) - 1]])
    inverse = torch.linalg.inv(matrix + damping.diag())[index[0]][:, index[0]]
    real = torch.ones_like(index, dtype=torch.bool)
    first = InverseColumns.at(factorization, index[:, :2], real[:, :2])
    columns = first.join(InverseColumns.at(factorization, index[:, 2:], real[:, 2:]))
    torch.testing.assert_close(columns.block()[0], inverse, rtol=1e-9, atol=0)


def test_batch_equals_loop():
    objective, state = toy(batch=(2, 3), windows=2, shared=2)
    equations = assemble(objective, state)
    step = factorize(equations, torch.full_like(equations.gradient(), 1e-3)).newton_step(equations)
    for index in range(6):
        place = divmod(index, 3)
        alone = Frames(state.frame[place], state.shared[place])
        data = objective.energies["data"]
        single = Objective({**objective.energies, "data": _pick(data, place)})
        own = assemble(single, alone)
        other = factorize(own, torch.full_like(own.gradient(), 1e-3)).newton_step(own)
        torch.testing.assert_close(step[index : index + 1], other, rtol=1e-10, atol=1e-12)


def test_weights_may_differ_over_the_batch():
    objective, state = toy(batch=(2,), windows=1)
    smooth = objective.energies["smooth"]
    weights = torch.tensor([0.5, 3.0], dtype=torch.float64)
    mixed = Objective(smooth=Smoothness(smooth.basis, smooth.keep, smooth.scale, weights))
    gradient = assemble(mixed, state).gradient()
    for index, weight in enumerate(weights):
        single = Objective(smooth=Smoothness(smooth.basis, smooth.keep, smooth.scale, weight))
        alone = Frames(state.frame[index], state.shared[index])
        torch.testing.assert_close(gradient[index], assemble(single, alone).gradient()[0])


def test_pull_of_removed_components_is_exactly_zero():
    objective, state = toy(frames=50)
    (window,) = assemble(objective, state).windows
    assert torch.equal(window.pull_in_basis(), torch.zeros_like(window.pull_in_basis()))


def test_indefinite_matrix_is_marked_and_does_not_spread():
    objective, state = toy(batch=(2,), windows=0)
    equations = assemble(objective, state)
    damping = torch.full_like(equations.gradient(), 1e-3)
    damping[0] = -1e3
    factorization = factorize(equations, damping)
    assert factorization.valid.tolist() == [False, True]
    assert factorization.newton_step(equations).isfinite().all()


def test_window_coupling_needs_a_window_energy():
    class Loose(Energy):
        coupling = Coupling.WINDOW

        def residual(self, state):
            return Residual(state.frame.diff(dim=-2).unsqueeze(-2))

    with pytest.raises(InputError, match=r"'loose' .Loose. has WINDOW coupling"):
        assemble(Objective(loose=Loose()), toy()[1])


def test_window_energies_see_no_shared_unknowns():
    smooth = Smoothness(cosine_basis(2, 7), torch.ones(2), torch.ones(4))
    smooth.sees = ("all",)
    with pytest.raises(InputError, match="sees shared unknowns through a window"):
        assemble(Objective(smooth=smooth), toy(shared=1)[1])


def _pick(data, place):
    return type(data)(
        data.matrix[place],
        data.target[place],
        data.confidence[place],
        data.weight,
        shared=bool(data.sees),
    )


class Linear(WindowEnergy):
    """Features that a float32 holds exactly."""

    def __init__(self, basis, matrix):
        super().__init__(basis, torch.ones(len(basis), dtype=basis.dtype))
        self.register_buffer("matrix", matrix)

    def features(self, state):
        return state.frame @ self.matrix.mT


@pytest.mark.parametrize(
    ("ratio", "features", "tolerance"),
    [(1e-2, 6, 1e-5), (1e-4, 6, 1e-5), (1e-6, 6, 1e-5), (1e-8, 6, 1e-5), (1e-2, 7, 1e-4)],
)
def test_weak_data_keep_their_digits_in_float32(ratio, features, tolerance):
    # forming I - J M^-1 J' by subtraction is off by 1e-4 at a ratio of 1e-2, 1e-2 at 1e-4, and
    # indefinite at 1e-6
    data = toy(frames=20, dim=6, groups=4, windows=0, data=ratio)[0].energies["data"]
    state = toy(frames=20, dim=6, windows=0)[1]
    scale = torch.tensor([0.5, 1, 2, 1, 4, 1, 0.5], dtype=torch.float64)
    matrix = (
        torch.cat((torch.eye(6), torch.eye(6)[:1])).double()[:features] * scale[:features, None]
    )
    objective = Objective(data=data, linear=Linear(cosine_basis(4, 20), matrix))

    def newton(state):
        equations = assemble(objective, state)
        damping = torch.full_like(equations.gradient(), 1e-3 * ratio)
        return factorize(equations, damping).newton_step(equations).double()

    exact = newton(state)
    objective.float()
    single = newton(state.to(torch.float32))
    assert (single - exact).norm() < tolerance * exact.norm()


def test_closed_forms_of_other_frames_or_unknowns_are_refused() -> None:
    """One frame's derivative was taken for that of all."""
    value = torch.zeros(2, 3, 4, 1)
    for shape in ((2, 1, 4, 1, 5), (2, 6, 4, 1, 5), (2, 3, 3, 1, 5), (2, 3, 4, 1, 6)):
        with pytest.raises(InputError, match="linearize returned a derivative"):
            require_slopes(None, torch.zeros(shape), value, 5)
    require_slopes(None, torch.zeros(1, 3, 4, 1, 5), value, 5)
