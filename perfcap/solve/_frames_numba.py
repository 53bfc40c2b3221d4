"""Factors of every frame's block as compiled loops, for plain tensors on the CPU.

Says the same as ``frame_factors.py`` in torch, which tests hold it equal to. Features of a window
energy are often the unknowns in other units; their Jacobian then has orthogonal columns, which a
file of its own makes use of.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel
from perfcap.solve._orthogonal_frames_numba import (
    factorize_orthogonal,
    find_columns,
    room_for_columns,
)
from perfcap.solve._products_numba import (
    add_gram,
    factorize_square,
    fill_diagonal,
    solve_lower,
    solve_upper,
    transpose,
)

Floats = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]


def factorize_frames(
    curvature: Tensor, damping: Tensor, jacobian: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """See ``frame_factors.factorize_frames``."""
    *lead, features, dim = jacobian.shape
    new, count = curvature.new_empty, damping.shape[:-1].numel()
    cholesky, solved = new(*lead, dim, dim), new(*lead, dim, features)
    defect, valid = new(*lead, features, features), damping.isfinite().all(-1)
    factorize_each(
        _rows(curvature, count, dim, dim),
        _rows(damping, count, dim),
        _rows(jacobian, count, features, dim),
        _rows(cholesky, count, dim, dim),
        _rows(solved, count, dim, features),
        _rows(defect, count, features, features),
        valid.numpy().reshape(count),
    )
    return cholesky, solved, defect, valid


def solve_frames(cholesky: Tensor, right: Tensor) -> Tensor:
    """See ``frame_factors.solve_frames``."""
    count, dim = right.shape[:-1].numel(), right.shape[-1]
    solved = right.contiguous().clone()
    _solve_frames(_rows(cholesky, count, dim, dim), _rows(solved, count, dim))
    return solved


def _rows(tensor: Tensor, *shape: int) -> Floats:
    """Contiguous, as another memory layout would compile the kernels once more."""
    return np.ascontiguousarray(tensor.detach().numpy()).reshape(shape)


@kernel()
def factorize_each(
    curvature: Floats,
    damping: Floats,
    jacobian: Floats,
    cholesky: Floats,
    solved: Floats,
    defect: Floats,
    valid: Flags,
) -> None:
    """All frames, one after the other: what one needs stays in the nearest cache."""
    damped = np.empty_like(curvature[0])
    columns = room_for_columns(jacobian[0])
    for n in range(len(curvature)):
        _lay_out(curvature[n], damping[n], damped)
        if valid[n]:
            parts = cholesky[n], solved[n], defect[n]
            if find_columns(jacobian[n], columns):
                valid[n] = factorize_orthogonal(damped, columns, *parts)
            else:
                valid[n] = _factorize_any(damped, jacobian[n], *parts)
        if not valid[n]:  # identities, which are finite
            fill_diagonal(cholesky[n], 1)
            fill_diagonal(solved[n], 0)
            fill_diagonal(defect[n], 1)


@inner()
def _factorize_any(
    damped: Floats,
    jacobian: Floats,
    cholesky: Floats,
    solved: Floats,
    defect: Floats,
) -> bool:
    """One frame; False if its matrix is not positive definite."""
    upper, turned, pulled = damped.copy(), np.empty_like(solved), np.zeros_like(solved)
    add_gram(upper, jacobian, jacobian)
    if not factorize_square(upper):
        return False
    transpose(upper, cholesky)
    transpose(jacobian, turned)
    transpose(jacobian, solved)
    solve_lower(upper, solved)
    solve_upper(upper, cholesky, solved)  # Y = M^-1 J'
    missing = np.empty_like(defect)
    fill_diagonal(missing, -1)
    add_gram(missing, turned, solved)  # J Y - I
    add_gram(pulled, damped, solved)  # A Y
    fill_diagonal(defect, 0)
    add_gram(defect, missing, missing)
    add_gram(defect, solved, pulled)
    return True


@inner()
def _lay_out(curvature: Floats, damping: Floats, damped: Floats) -> None:
    """The damped curvature."""
    for i in range(len(damped)):
        for j in range(len(damped)):
            damped[i, j] = curvature[i, j]
        damped[i, i] = curvature[i, i] + damping[i]


@kernel(fastmath={"contract", "reassoc"})
def _solve_frames(cholesky: Floats, solved: Floats) -> None:
    """In place, along the rows of the factors."""
    dim = solved.shape[1]
    for n in range(len(solved)):
        root, x = cholesky[n], solved[n]
        for i in range(dim):
            inner = x[i]
            for k in range(i):
                inner -= root[i, k] * x[k]
            x[i] = inner / root[i, i]
        for i in range(dim - 1, -1, -1):
            x[i] /= root[i, i]
            for k in range(i):
                x[k] -= root[i, k] * x[i]
