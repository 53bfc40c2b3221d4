"""One nonnegative program, inside compiled loops; see ``nonnegative.py`` for the method."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner
from perfcap.solve._products_numba import dot, factorize_square, solve_lower, solve_upper_vector

Floats = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]


@inner()
def solve_nonnegative(
    matrix: Floats,
    target: Floats,
    tolerance: float,
    support: Flags,
    rounds: int,
    value: Floats,
) -> bool:
    """``NonnegativeProgram.solve`` into ``value``; a guess of the ``support`` is used up."""
    best = np.empty_like(value)
    for i in range(len(value)):
        value[i] = 0
    for _ in range(rounds):
        if not _minimize_on(matrix, target, support, best):
            return False
        if _drop_unwanted(support, best, value):
            continue
        whole = _step_towards(best, value, support)
        if whole and not _enter(matrix, target, tolerance, support, value):
            return True
    return False


@inner()
def _minimize_on(matrix: Floats, target: Floats, support: Flags, best: Floats) -> bool:
    """Minimum over the entries of the support, zero elsewhere; False if there is none."""
    index, count = np.empty(len(support), np.int64), 0
    for i in range(len(support)):
        best[i] = 0
        if support[i]:
            index[count] = i
            count += 1
    upper = np.empty((count, count), matrix.dtype)
    right = np.empty((count, 1), matrix.dtype)
    for i in range(count):
        right[i, 0] = target[index[i]]
        for j in range(count):
            upper[i, j] = matrix[index[i], index[j]]
    if not factorize_square(upper):
        return False
    solve_lower(upper, right)
    solve_upper_vector(upper, right[:, 0])
    for i in range(count):
        best[index[i]] = right[i, 0]
    return True


@inner()
def _drop_unwanted(support: Flags, best: Floats, value: Floats) -> bool:
    """Take entries out that are zero and want to be less; whether there were any."""
    dropped = False
    for i in range(len(support)):
        if support[i] and best[i] <= 0 and value[i] <= 0:
            support[i] = False
            dropped = True
    return dropped


@inner()
def _step_towards(best: Floats, value: Floats, support: Flags) -> bool:
    """Move to ``best`` or until an entry reaches zero; whether the whole step was taken."""
    length, whole = best.dtype.type(1), True
    for i in range(len(value)):
        if support[i] and best[i] <= 0:
            length, whole = min(length, value[i] / (value[i] - best[i])), False
    for i in range(len(value)):
        if support[i] and best[i] <= 0 and value[i] / (value[i] - best[i]) <= length:
            support[i] = False
        moved = best[i] if whole else value[i] + length * (best[i] - value[i])
        value[i] = moved if support[i] else 0
    return whole


@inner()
def _enter(matrix: Floats, target: Floats, tolerance: float, support: Flags, value: Floats) -> bool:
    """Take entries in whose slope asks for it; whether there were any."""
    entered = False
    for i in range(len(value)):
        if not support[i] and target[i] - dot(matrix[i], value) > tolerance:
            support[i] = True
            entered = True
    return entered
