"""Factors of every frame's block as compiled loops, for plain tensors on the CPU.

Says the same as ``frame_factors.py`` in torch, which tests hold it equal to.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.solve._products_numba import add_gram, factorize_square, solve_lower, solve_upper

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
    _factorize(
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


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _factorize(
    curvature: Floats,
    damping: Floats,
    jacobian: Floats,
    cholesky: Floats,
    solved: Floats,
    defect: Floats,
    valid: Flags,
) -> None:
    """All frames, one after the other: what one needs stays in the nearest cache."""
    features, dim = jacobian.shape[1:]
    damped = np.empty((dim, dim), curvature.dtype)
    upper = np.empty((dim, dim), curvature.dtype)
    turned = np.empty((dim, features), curvature.dtype)
    pulled = np.empty((dim, features), curvature.dtype)
    missing = np.empty((features, features), curvature.dtype)
    for n in range(len(curvature)):
        _lay_out(curvature[n], damping[n], jacobian[n], damped, upper, turned, solved[n])
        add_gram(upper, jacobian[n], jacobian[n])
        valid[n] = valid[n] and factorize_square(upper)
        if valid[n]:
            _transpose(upper, cholesky[n])
            solve_lower(upper, solved[n])
            solve_upper(upper, cholesky[n], solved[n])  # Y = M^-1 J'
            _set(missing, -1)
            add_gram(missing, turned, solved[n])  # J Y - I
            _set(pulled, 0)
            add_gram(pulled, damped, solved[n])  # A Y
            _set(defect[n], 0)
            add_gram(defect[n], missing, missing)
            add_gram(defect[n], solved[n], pulled)
        else:  # identities, which are finite
            _set(cholesky[n], 1)
            _set(solved[n], 0)
            _set(defect[n], 1)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _lay_out(
    curvature: Floats,
    damping: Floats,
    jacobian: Floats,
    damped: Floats,
    upper: Floats,
    turned: Floats,
    solved: Floats,
) -> None:
    """The damped curvature, twice, and the Jacobian's transpose, twice."""
    for i in range(len(damped)):
        for j in range(len(damped)):
            damped[i, j] = upper[i, j] = curvature[i, j]
        damped[i, i] = upper[i, i] = curvature[i, i] + damping[i]
        for e in range(len(jacobian)):
            turned[i, e] = solved[i, e] = jacobian[e, i]


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _transpose(matrix: Floats, transposed: Floats) -> None:
    for i in range(len(matrix)):
        for j in range(len(transposed)):
            transposed[j, i] = matrix[i, j]


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _set(matrix: Floats, diagonal: int) -> None:
    for i in range(len(matrix)):
        for j in range(matrix.shape[1]):
            matrix[i, j] = diagonal if i == j else 0


@numba.njit(nogil=True, cache=True, fastmath={"contract", "reassoc"})  # type: ignore[untyped-decorator]
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
