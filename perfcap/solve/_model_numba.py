"""A factorization as arrays, for compiled loops; there are no shared unknowns here."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel
from perfcap.solve._products_numba import add_multiple, dot, solve_lower_vector, solve_upper_vector
from perfcap.solve.normal_equations import NormalEquations

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]


class Model(NamedTuple):
    """A factorization: H^-1 = M^-1 + M^-1 U (R' R)^-1 U' M^-1 with R x R upper ``root``.

    A row of the bases sees ``size`` features from ``feature`` on, which are rows of the root from
    ``start`` on.
    """

    cholesky: Floats  # lower factors of M_f, (B, F, D, D)
    solved: Floats  # Y, (B, F, D, E)
    jacobian: Floats  # J, (B, F, E, D)
    defect: Floats  # G, (B, F, E, E)
    bases: Floats  # of all window energies, one above the other, (K, F)
    start: Indices  # (K,)
    feature: Indices  # (K,)
    size: Indices  # (K,)
    root: Floats  # (B, R, R)


class Bases(NamedTuple):
    """Temporal bases of window energies, and how many features each sees."""

    rows: tuple[Tensor, ...]  # (R_k, F)
    sizes: list[int]


def as_arrays(
    cholesky: Tensor, solved: Tensor, jacobian: Tensor, defect: Tensor, bases: Bases, root: Tensor
) -> Model:
    """The arrays of a factorization without shared unknowns; see ``Model``."""
    rows, sizes = bases
    size = np.repeat(np.array(sizes, np.int64), [len(basis) for basis in rows])
    return Model(
        plain(cholesky),
        plain(solved),
        plain(jacobian),
        plain(defect),
        plain(torch.cat((cholesky.new_empty(0, cholesky.shape[1]), *rows))),
        np.cumsum(size) - size,
        np.repeat(np.cumsum([0, *sizes], dtype=np.int64)[:-1], [len(basis) for basis in rows]),
        size,
        plain(root),
    )


def plain(tensor: Tensor) -> NDArray[Any]:
    """Contiguous, as another memory layout would compile the kernels once more."""
    return np.ascontiguousarray(tensor.detach().numpy())


def newton_step(model: Model, equations: NormalEquations) -> Tensor:
    """See ``Factorization.newton_step``."""
    windows, gradient = equations.windows, equations.frame_gradient
    step = gradient.new_empty(len(gradient), equations.layout.unknowns)
    newton_steps(
        model,
        plain(gradient),
        plain(torch.cat([window.features for window in windows], -1)),
        plain(torch.cat([window.complement for window in windows]).to(gradient)),
        step.numpy(),
    )
    return step


@kernel()
def newton_steps(
    model: Model, gradient: Floats, features: Floats, complement: Floats, step: Floats
) -> None:
    """Steps (B, N); gradients of the data (B, F, D), features (B, F, E), complements (K,)."""
    frames, dim = gradient.shape[1:]
    for b in range(len(step)):
        pull, seen = features[b].copy(), np.empty_like(features[b])
        right = np.zeros(model.root.shape[1], model.root.dtype)
        to_basis(model, features[b], right)
        from_basis(model, -right, pull)
        for f in range(frames):
            own = step[b, f * dim : (f + 1) * dim]
            for i in range(dim):  # assigning slices would take seconds to compile
                own[i] = -gradient[b, f, i]
            solve_frame(model.cholesky[b, f], own)
            seen[f] = 0
            _add_product(model.jacobian[b, f], own, seen[f])
            _add_product(model.defect[b, f], pull[f], seen[f])  # -U' M^-1 of the gradient
        for t in range(len(model.bases)):
            for r in range(model.start[t], model.start[t] + model.size[t]):
                right[r] = -complement[t] * right[r]
        to_basis(model, seen, right)
        _solve_root(model.root[b], right)
        for f in range(frames):
            for e in range(pull.shape[1]):
                pull[f, e] = -pull[f, e]  # M^-1 of the prior's gradient is Y times its pull
        from_basis(model, right, pull)
        for f in range(frames):
            _add_product(model.solved[b, f], pull[f], step[b, f * dim : (f + 1) * dim])


@kernel()
def to_basis(model: Model, features: Floats, rows: Floats) -> None:
    """Add the components of features (F, E) in the bases to rows (R,)."""
    for t in range(len(model.bases)):
        start, first, size = model.start[t], model.feature[t], model.size[t]
        components = rows[start : start + size]
        for f in range(len(features)):
            add_multiple(model.bases[t, f], features[f, first : first + size], components)


@inner()
def from_basis(model: Model, rows: Floats, features: Floats) -> None:
    """Add components in the bases, rows (R,), to features (F, E)."""
    for t in range(len(model.bases)):
        start, first, size = model.start[t], model.feature[t], model.size[t]
        components = rows[start : start + size]
        for f in range(len(features)):
            add_multiple(model.bases[t, f], components, features[f, first : first + size])


@inner()
def solve_frame(lower: Floats, right: Floats) -> None:
    """``(L L')^-1`` times a vector, in place, along the rows of L."""
    for i in range(len(right)):
        right[i] = (right[i] - dot(lower[i, :i], right[:i])) / lower[i, i]
    solve_transposed(lower, right)


@inner()
def solve_transposed(lower: Floats, right: Floats) -> None:
    """``(L')^-1`` times a vector, in place, along the rows of L."""
    for i in range(len(right) - 1, -1, -1):
        right[i] /= lower[i, i]
        add_multiple(-right[i], lower[i, :i], right[:i])


@inner()
def _solve_root(upper: Floats, right: Floats) -> None:
    """``(R'R)^-1`` times a vector, in place, along the rows of R."""
    solve_lower_vector(upper, right)
    solve_upper_vector(upper, right)


@inner()
def _add_product(matrix: Floats, vector: Floats, total: Floats) -> None:
    """``total += matrix @ vector``."""
    for i in range(len(total)):
        total[i] += dot(matrix[i], vector)
