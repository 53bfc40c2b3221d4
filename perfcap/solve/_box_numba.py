"""Box-constrained steps as compiled loops, for plain tensors on the CPU.

Says the same as ``box_step.py`` in torch, which tests hold it equal to, one batch element after
the other. Steps are taken from the columns of the inverse that are at hand anyway, so a round
costs a fraction of a solve. There are no shared unknowns here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel
from perfcap.solve._model_numba import Model, from_basis, plain, solve_transposed
from perfcap.solve._nonnegative_numba import solve_nonnegative
from perfcap.solve._products_numba import dot, solve_lower, solve_lower_vector, solve_upper_vector
from perfcap.solve.bounds import StepBox
from perfcap.solve.factorization import Factorization

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]
_FEW = 8  # columns that are solved one by one, along the rows of the root


class _Columns(NamedTuple):
    """``E' H^-1 E`` and its halves for unit vectors E; see ``InverseColumns``."""

    unknowns: Indices  # (m,)
    own: Floats  # (m, D)
    common: Floats  # (m, R)
    block: Floats  # (m, m)


def box_steps(
    factorization: Factorization,
    newton: Tensor,
    box: StepBox,
    held: Tensor,
    unit: Tensor,
    tolerance: Tensor,
    limits: tuple[int, int],
) -> tuple[Tensor, Tensor, Tensor]:
    """Steps and multipliers (B, N), and whether they are exact (B,).

    Args:
        factorization: without shared unknowns.
        newton: the unconstrained minimiser, (B, N).
        box: bounds on the step.
        held: sides of the bounds to begin with, 0 for none, (B, N).
        unit: in which violations of different unknowns are compared, (B, N).
        tolerance: violations that are rounding, in these units, (B, 1).
        limits: most rounds of joining bounds, and of each nonnegative program.
    """
    step, multipliers = newton.clone(), torch.zeros_like(newton)
    exact = torch.zeros_like(newton[:, 0], dtype=torch.bool)
    given = (plain(x) for x in (newton, box.lowest, box.highest, held.clone(), unit, tolerance))
    outcome = step.numpy(), multipliers.numpy(), exact.numpy()
    solve_all(factorization.arrays, *given, *limits, *outcome)
    return step, multipliers, exact


@kernel()
def solve_all(
    model: Model,
    newton: Floats,
    lowest: Floats,
    highest: Floats,
    held: Floats,
    unit: Floats,
    tolerance: Floats,
    rounds: int,
    pivots: int,
    step: Floats,
    multipliers: Floats,
    exact: NDArray[np.bool_],
) -> None:
    """All batch elements; ``held`` is used up, ``step`` comes as ``newton``."""
    dim = model.cholesky.shape[2]
    for b in range(len(newton)):
        columns = _no_columns(model)
        joins, fresh = _begin(held[b])
        solved, joining = True, len(fresh) > 0
        for _ in range(rounds):
            if joining:
                columns = _with_columns(model, b, columns, fresh)
                solved = _hold(
                    columns,
                    newton[b],
                    lowest[b],
                    highest[b],
                    held[b],
                    unit[b],
                    joins,
                    tolerance[b, 0],
                    pivots,
                    multipliers[b],
                )
                _copy(newton[b], step[b])
                _pull_back(model, b, columns, multipliers[b], step[b])
            sides = lowest[b], highest[b], held[b]
            fresh = _join(step[b], *sides, unit[b], joins, tolerance[b, 0], dim)
            joining = joins.any()
            if not joining:
                break
        exact[b] = solved and not joining


@inner()
def _begin(held: Floats) -> tuple[NDArray[np.bool_], Indices]:
    """Which bounds are held at first, as flags and as indices."""
    joins, fresh, count = np.zeros(len(held), np.bool_), np.empty(len(held), np.int64), 0
    for n in range(len(held)):
        if held[n] != 0:
            joins[n] = True
            fresh[count] = n
            count += 1
    return joins, fresh[:count]


@inner()
def _no_columns(model: Model) -> _Columns:
    dtype = model.root.dtype
    dim, rows = model.cholesky.shape[2], model.root.shape[1]
    return _Columns(
        np.empty(0, np.int64),
        np.empty((0, dim), dtype),
        np.empty((0, rows), dtype),
        np.empty((0, 0), dtype),
    )


@inner()
def _with_columns(model: Model, b: int, columns: _Columns, fresh: Indices) -> _Columns:
    """The columns, and those at ``fresh`` unknowns after them."""
    if len(fresh) == 0:
        return columns
    old, dim = len(columns.unknowns), model.cholesky.shape[2]
    size = old + len(fresh)
    index = np.empty(size, np.int64)
    own = np.zeros((size, dim), model.root.dtype)
    common = np.empty((size, model.root.shape[1]), model.root.dtype)
    block = np.empty((size, size), model.root.dtype)
    for i in range(old):
        index[i] = columns.unknowns[i]
        _copy(columns.own[i], own[i])
        _copy(columns.common[i], common[i])
        _copy(columns.block[i], block[i])
    for i in range(old, size):
        index[i] = fresh[i - old]
    _halve_frames(model.cholesky[b], fresh, own[old:])
    _halve_windows(model, b, fresh, common[old:])
    for i in range(old, size):
        for j in range(i + 1):
            product = dot(common[i], common[j])
            if index[i] // dim == index[j] // dim:
                product += dot(own[i], own[j])
            block[i, j] = block[j, i] = product
    return _Columns(index, own, common, block)


@inner()
def _copy(source: Floats, target: Floats) -> None:
    """Into the beginning of a row; assigning slices would take seconds to compile."""
    for i in range(len(source)):
        target[i] = source[i]


@inner()
def _halve_frames(cholesky: Floats, fresh: Indices, own: Floats) -> None:
    """``L_f^-1 e`` of unit vectors, by rows that come as zeros: nothing precedes their entry."""
    dim = cholesky.shape[1]
    for m in range(len(fresh)):
        root, first, x = cholesky[fresh[m] // dim], fresh[m] % dim, own[m]
        x[first] = 1
        for i in range(first, dim):
            for k in range(first, i):
                x[i] -= root[i, k] * x[k]
            x[i] /= root[i, i]


@inner()
def _halve_windows(model: Model, b: int, fresh: Indices, common: Floats) -> None:
    """``(R')^-1 U' M^-1 e`` of unit vectors, by rows."""
    dim, rows = model.cholesky.shape[2], model.root.shape[1]
    right = np.empty((rows, len(fresh)), common.dtype)
    for m in range(len(fresh)):
        frame, inner = fresh[m] // dim, fresh[m] % dim
        for t in range(len(model.bases)):
            for i in range(model.size[t]):
                seen = model.solved[b, frame, inner, model.feature[t] + i]
                right[model.start[t] + i, m] = model.bases[t, frame] * seen
    if len(fresh) >= _FEW:
        solve_lower(model.root[b], right)
    for m in range(len(fresh)):
        for r in range(rows):
            common[m, r] = right[r, m]
        if len(fresh) < _FEW:
            solve_lower_vector(model.root[b], common[m])


@inner()
def _hold(
    columns: _Columns,
    newton: Floats,
    lowest: Floats,
    highest: Floats,
    held: Floats,
    unit: Floats,
    joins: NDArray[np.bool_],
    tolerance: float,
    pivots: int,
    multipliers: Floats,
) -> bool:
    """Multipliers that keep the held bounds; whether they are exact."""
    index = columns.unknowns
    size = len(index)
    matrix, excess = np.empty_like(columns.block), np.empty(size, newton.dtype)
    support, value = np.empty(size, np.bool_), np.empty(size, newton.dtype)
    for i in range(size):
        n = index[i]
        bound = highest[n] if held[n] > 0 else lowest[n]
        excess[i] = held[n] * (newton[n] - bound) / unit[n]
        support[i] = joins[n] or multipliers[n] != 0
        for j in range(size):
            sides = held[n] * held[index[j]] / (unit[n] * unit[index[j]])
            matrix[i, j] = sides * columns.block[i, j]
    exact: bool = solve_nonnegative(matrix, excess, tolerance, support, pivots, value)
    multipliers[:] = 0
    for i in range(size):
        multipliers[index[i]] = held[index[i]] * value[i] / unit[index[i]]
    return exact


@inner()
def _pull_back(model: Model, b: int, columns: _Columns, multipliers: Floats, step: Floats) -> None:
    """``step -= H^-1 multipliers``, from the halves of its columns."""
    frames, dim = model.cholesky.shape[1], model.cholesky.shape[2]
    rows, features = model.root.shape[1], model.solved.shape[3]
    pull = np.zeros((frames, dim), step.dtype)
    across = np.zeros(rows, step.dtype)
    for i in range(len(columns.unknowns)):
        share = multipliers[columns.unknowns[i]]
        if share != 0:
            frame = columns.unknowns[i] // dim
            for k in range(dim):
                pull[frame, k] += share * columns.own[i, k]
            for r in range(rows):
                across[r] += share * columns.common[i, r]
    solve_upper_vector(model.root[b], across)
    spread = np.zeros((frames, features), step.dtype)
    from_basis(model, across, spread)
    for frame in range(frames):
        solve_transposed(model.cholesky[b, frame], pull[frame])
        for i in range(dim):
            own = dot(model.solved[b, frame, i], spread[frame])
            step[frame * dim + i] -= pull[frame, i] + own


@inner()
def _join(
    step: Floats,
    lowest: Floats,
    highest: Floats,
    held: Floats,
    unit: Floats,
    joins: NDArray[np.bool_],
    tolerance: float,
    dim: int,
) -> Indices:
    """Find the bounds that join, hold them, and return those that were not held yet.

    They are the worst among their neighbours in time.
    """
    size, count = len(step), 0
    violation, fresh = np.empty_like(step), np.empty(size, np.int64)
    for n in range(size):
        violation[n] = max(step[n] - highest[n], lowest[n] - step[n])
    for n in range(size):
        worst = violation[n] > tolerance * unit[n]
        worst = worst and (n < dim or violation[n] >= violation[n - dim])
        worst = worst and (n + dim >= size or violation[n] >= violation[n + dim])
        side = 1 if step[n] - highest[n] > lowest[n] - step[n] else -1
        joins[n] = worst and side != held[n]
        if joins[n]:
            if held[n] == 0:
                fresh[count] = n
                count += 1
            held[n] = side
    return fresh[:count]
