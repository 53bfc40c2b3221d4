"""Factors of a frame's block where the Jacobian of its features has orthogonal columns.

With d the lengths of the columns, ``J = Q diag(d)`` and ``Q'Q = I``. In units of the features the
damped curvature is ``B = diag(1/d) A diag(1/d)``, and

    M = diag(d) (I + B) diag(d),   Y = diag(1/d) (I - N) Q',   G = (I - QQ')^2 + Q N Q'

with ``N = B (I + B)^-1``: two triangular solves instead of those and three products. Where data
are weak N is small and keeps its digits; ``I - QQ'`` is a projection, so its square is itself but
for rounding, which squaring makes vanish.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner
from perfcap.solve._products_numba import (
    factorize_square,
    fill_diagonal,
    solve_lower,
    solve_upper,
    transpose,
)

Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]


class Columns(NamedTuple):
    """Orthogonal columns of a sparse Jacobian; room for those of any frame."""

    unit: Floats  # Q, (E, D)
    entries: Indices  # columns of each row that are not zero, one after the other, (E, D)
    filled: Indices  # how many a row has, (E,)
    length: Floats  # d, (D,)


@inner()
def room_for_columns(jacobian: Floats) -> Columns:
    """Columns to be found in Jacobians (E, D) of this size."""
    features, dim = jacobian.shape
    return Columns(
        np.empty_like(jacobian),
        np.empty((features, dim), np.int64),
        np.empty(features, np.int64),
        np.empty(dim, jacobian.dtype),
    )


@inner()
def find_columns(jacobian: Floats, columns: Columns) -> bool:
    """Write the columns of J; False unless they are orthogonal and none is zero."""
    unit, entries, filled, length = columns
    dim = len(length)
    gram = np.zeros((dim, dim), jacobian.dtype)
    for e in range(len(filled)):
        filled[e] = 0
        for i in range(dim):
            unit[e, i] = 0
            if jacobian[e, i] != 0:
                entries[e, filled[e]] = i
                filled[e] += 1
        for k in range(filled[e]):
            i = entries[e, k]
            for m in range(k + 1):
                gram[i, entries[e, m]] += jacobian[e, i] * jacobian[e, entries[e, m]]
    for i in range(dim):
        length[i] = np.sqrt(gram[i, i])
    for e in range(len(filled)):
        for k in range(filled[e]):
            unit[e, entries[e, k]] = jacobian[e, entries[e, k]] / length[entries[e, k]]
    return bool(_orthogonal(gram, length))


@inner()
def _orthogonal(gram: Floats, length: Floats) -> bool:
    """Whether ``J'J``, of which the lower half is given, is a diagonal of positive numbers."""
    rounding = 8 * np.finfo(gram.dtype).eps
    for i in range(len(gram)):
        if not 0 < length[i] < np.inf:
            return False
        for j in range(i):
            if abs(gram[i, j]) > rounding * length[i] * length[j]:
                return False
    return True


@inner()
def factorize_orthogonal(
    damped: Floats, columns: Columns, cholesky: Floats, solved: Floats, defect: Floats
) -> bool:
    """One frame, see ``factorize_frames``; False if its matrix is not positive definite.

    Args:
        damped: A, (D, D), turned into N.
        columns: of J.
        cholesky: lower factor of M, (D, D), to be written like those that follow.
        solved: Y, (D, E).
        defect: G, (E, E).
    """
    shorter = 1 / columns.length
    upper = _scale(damped, shorter)
    if not factorize_square(upper):
        return False
    transpose(upper, cholesky)
    solve_lower(upper, damped)
    solve_upper(upper, cholesky, damped)
    for i in range(len(damped)):
        for j in range(i + 1):
            cholesky[i, j] *= columns.length[i]
    _pull_back(damped, columns, shorter, solved, defect)
    return True


@inner()
def _scale(damped: Floats, shorter: Floats) -> Floats:
    """Turn A into B and return I + B."""
    upper = np.empty_like(damped)
    for i in range(len(damped)):
        for j in range(len(damped)):
            damped[i, j] *= shorter[i] * shorter[j]
            upper[i, j] = damped[i, j]
        upper[i, i] += shorter.dtype.type(1)
    return upper


@inner()
def _pull_back(
    shrunk: Floats, columns: Columns, shorter: Floats, solved: Floats, defect: Floats
) -> None:
    """Y and G from N, ``shrunk``."""
    features, dim = columns.unit.shape
    turned, missing = np.empty((dim, features), shrunk.dtype), np.empty_like(defect)
    across = np.zeros((features, dim), shrunk.dtype)
    _add_product(columns, shrunk, across)  # Q N
    transpose(across, solved)
    transpose(columns.unit, turned)
    fill_diagonal(missing, -1)
    _add_product(columns, turned, missing)  # Q Q' - I
    _square(missing, defect)
    _add_product(columns, solved, defect)
    for i in range(dim):
        for e in range(features):
            solved[i, e] = shorter[i] * (turned[i, e] - solved[i, e])


@inner(fastmath={"contract"})
def _add_product(columns: Columns, right: Floats, total: Floats) -> None:
    """``total += Q @ right``."""
    for e in range(len(total)):
        for k in range(columns.filled[e]):
            i = columns.entries[e, k]
            factor = columns.unit[e, i]
            for j in range(right.shape[1]):
                total[e, j] += factor * right[i, j]


@inner()
def _square(matrix: Floats, squared: Floats) -> None:
    """The square of a symmetric matrix that is mostly zero."""
    size = len(matrix)
    for i in range(size):
        for j in range(size):
            squared[i, j] = 0
        for k in range(size):
            factor = matrix[i, k]
            if factor != 0:
                for j in range(size):
                    squared[i, j] += factor * matrix[k, j]
