"""Products of small matrices, inside compiled loops."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from perfcap.kernels import inner, kernel

Floats = NDArray[np.floating[Any]]


@inner()
def add_gram(total: Floats, left: Floats, right: Floats) -> None:
    """``total += left' @ right``."""
    whole = len(right) - len(right) % 8
    for k in range(0, whole, 8):
        add_eight(total, left, right, k, 0, len(total), False)
    for k in range(whole, len(right)):
        add_one(total, left, right, k, 0, len(total), False)


@kernel()
def transpose(matrix: Floats, transposed: Floats) -> None:
    """``transposed = matrix'``."""
    for i in range(len(matrix)):
        for j in range(len(transposed)):
            transposed[j, i] = matrix[i, j]


@inner()
def fill_diagonal(matrix: Floats, diagonal: int) -> None:
    """A number on the diagonal and zero elsewhere."""
    for i in range(len(matrix)):
        for j in range(matrix.shape[1]):
            matrix[i, j] = diagonal if i == j else 0


@inner(fastmath={"contract"})
def add_eight(
    total: Floats, left: Floats, right: Floats, k: int, first: int, last: int, minus: bool
) -> None:
    """``total += left[k:k + 8].T @ right[k:k + 8]``, or minus that, in the rows ``first:last``.

    Eight rows at once, since memory is slower than arithmetic. Where all their factors are zero
    nothing is done: joints move few points, and features are often the unknowns themselves.
    """
    for i in range(first, last):
        a, b, c, d = left[k, i], left[k + 1, i], left[k + 2, i], left[k + 3, i]
        p, q, r, s = left[k + 4, i], left[k + 5, i], left[k + 6, i], left[k + 7, i]
        if (a != 0 or b != 0 or c != 0 or d != 0) or (p != 0 or q != 0 or r != 0 or s != 0):
            if minus:
                a, b, c, d, p, q, r, s = -a, -b, -c, -d, -p, -q, -r, -s
            for j in range(right.shape[1]):
                upper = a * right[k, j] + b * right[k + 1, j]
                upper += c * right[k + 2, j] + d * right[k + 3, j]
                lower = p * right[k + 4, j] + q * right[k + 5, j]
                lower += r * right[k + 6, j] + s * right[k + 7, j]
                total[i, j] += upper + lower


@inner(fastmath={"contract"})
def add_one(
    total: Floats, left: Floats, right: Floats, k: int, first: int, last: int, minus: bool
) -> None:
    """The same of row ``k`` alone."""
    for i in range(first, last):
        factor = -left[k, i] if minus else left[k, i]
        if factor != 0:
            for j in range(right.shape[1]):
                total[i, j] += factor * right[k, j]


@inner()
def factorize_square(upper: Floats) -> bool:
    """Cholesky factor U of ``U'U``, in place; False if the matrix is not positive definite."""
    size, one = len(upper), upper.dtype.type(1)  # a plain 1 would make float32 float64
    for i in range(size):
        pivot = upper[i, i]
        if not 0 < pivot < np.inf:
            return False
        scale = one / np.sqrt(pivot)
        for j in range(size):
            upper[i, j] = scale * upper[i, j] if j >= i else 0
        end = min(i - i % 8 + 8, size)  # of a block: what follows it is updated once, by all
        add_one(upper, upper, upper, i, i + 1, end, True)
        if i + 1 == end and end < size:
            add_eight(upper, upper, upper, end - 8, end, size, True)
    return True


@inner()
def solve_lower(upper: Floats, right: Floats) -> None:
    """``(U')^-1`` times a matrix, in place."""
    size, one = len(right), right.dtype.type(1)
    for i in range(size):
        scale = one / upper[i, i]
        for j in range(right.shape[1]):
            right[i, j] *= scale
        end = min(i - i % 8 + 8, size)
        add_one(right, upper, right, i, i + 1, end, True)
        if i + 1 == end and end < size:
            add_eight(right, upper, right, end - 8, end, size, True)


@inner()
def solve_upper(upper: Floats, lower: Floats, right: Floats) -> None:
    """``U^-1`` times a matrix, in place, with L = U'."""
    size, one = len(right), right.dtype.type(1)
    for i in range(size - 1, -1, -1):
        scale = one / upper[i, i]
        for j in range(right.shape[1]):
            right[i, j] *= scale
        start = i - i % 8
        add_one(right, lower, right, i, start, i, True)
        if i == start and i + 8 <= size:
            add_eight(right, lower, right, start, 0, start, True)
        elif i == start:
            for k in range(start, size):
                add_one(right, lower, right, k, 0, start, True)


@inner()
def solve_lower_vector(upper: Floats, right: Floats) -> None:
    """``(U')^-1`` times a vector, in place, along the rows of U."""
    for i in range(len(right)):
        right[i] /= upper[i, i]
        add_multiple(-right[i], upper[i, i + 1 :], right[i + 1 :])


@inner(fastmath={"contract", "reassoc"})
def solve_upper_vector(upper: Floats, right: Floats) -> None:
    """``U^-1`` times a vector, in place, along the rows of U."""
    for i in range(len(right) - 1, -1, -1):
        rest = right[i]
        for k in range(i + 1, len(right)):
            rest -= upper[i, k] * right[k]
        right[i] = rest / upper[i, i]


@inner(fastmath={"contract", "reassoc"})
def dot(left: Floats, right: Floats) -> Any:
    """Of vectors."""
    total = left.dtype.type(0)  # a plain zero would make float32 float64
    for i in range(len(left)):
        total += left[i] * right[i]
    return total


@inner(fastmath={"contract"})
def add_multiple(factor: float, vector: Floats, total: Floats) -> None:
    """``total += factor * vector``.

    Of slices rather than by indices that are sums: those might be negative for all the compiler
    knows, and the check keeps it from using vector instructions.
    """
    for i in range(len(vector)):
        total[i] += factor * vector[i]
