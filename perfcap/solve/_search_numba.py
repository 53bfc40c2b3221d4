"""A round of conjugate gradients as compiled loops, for the CPU.

Says the same as ``_search_torch.py``, which tests hold it equal to. Lengths of tuples are known
when the kernels are compiled, so the innermost loops are unrolled; the tuples' entries mean
nothing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from perfcap.kernels import inner, kernel
from perfcap.solve.search import Search

Floats = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]


def invert(diagonal: Tensor, damping: Tensor, running: Tensor, inverse: Tensor) -> None:
    """See ``_search_torch.invert``."""
    arrays = (x.numpy() for x in (diagonal, damping, running, inverse))
    _invert(*arrays, (0,) * diagonal.shape[-1])


class Rounds:
    """See ``_search_torch.Rounds``."""

    def __init__(self, search: Search) -> None:
        self.unknowns = (0,) * search.step.shape[-1]
        self.slope, self.running = search.slope.numpy(), search.running.numpy()
        self.enough, self.worth = search.enough.numpy(), search.worth.numpy()
        self.rounds = search.rounds.numpy()
        self.residual, self.direction = search.residual.numpy(), search.direction.numpy()
        self.product, self.step = search.product.numpy(), search.step.numpy()
        self.damping, self.preconditioner = search.damping.numpy(), search.preconditioner.numpy()

    def go(self) -> None:
        """See ``_search_torch.Rounds``."""
        _go(
            self.damping,
            self.step,
            self.residual,
            self.direction,
            self.product,
            self.slope,
            self.worth,
            self.running,
            self.rounds,
            self.unknowns,
        )
        self.precondition()

    def precondition(self) -> None:
        """See ``_search_torch.Rounds``."""
        _precondition(self.preconditioner, self.residual, self.product, self.running, self.unknowns)

    def turn(self) -> None:
        """See ``_search_torch.Rounds``."""
        _turn(self.residual, self.direction, self.product, self.slope, self.enough, self.running)


@kernel()
def _invert(
    diagonal: Floats, damping: Floats, running: Flags, inverse: Floats, unknowns: tuple[int, ...]
) -> None:
    factor = np.empty((len(unknowns), len(unknowns)), diagonal.dtype)
    for p in range(len(diagonal)):
        for i in range(diagonal.shape[1]):
            if running[p] and _factorize(diagonal[p, i], damping[p, i], factor, unknowns):
                _from_factor(factor, inverse[p, i], unknowns)
                continue
            inverse[p, i] = 0
            for c in range(len(unknowns)):
                curve = diagonal[p, i, c, c] + damping[p, i, c]
                inverse[p, i, c, c] = 1 / curve if running[p] and curve > 0 else 1


@inner()
def _factorize(block: Floats, damping: Floats, factor: Floats, unknowns: tuple[int, ...]) -> bool:
    """Cholesky factor with the reciprocal of its diagonal on the diagonal; False if indefinite."""
    for i in range(len(unknowns)):
        for j in range(i + 1):
            rest = block[i, j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = rest * factor[j, j]
                continue
            rest += damping[i]
            if not rest > 0:
                return False
            factor[i, i] = 1 / math.sqrt(rest)
    return True


@inner()
def _from_factor(factor: Floats, inverse: Floats, unknowns: tuple[int, ...]) -> None:
    """``(L L')^-1`` of a factor whose diagonal holds reciprocals; the factor is overwritten."""
    count = len(unknowns)
    for j in range(count):
        for i in range(j + 1, count):
            rest = factor[i, j] * factor[j, j]
            for k in range(j + 1, i):
                rest += factor[i, k] * factor[k, j]
            factor[i, j] = -rest * factor[i, i]
    for i in range(count):
        for j in range(i + 1):
            dot = factor[i, i] * factor[i, j]
            for k in range(i + 1, count):
                dot += factor[k, i] * factor[k, j]
            inverse[i, j] = dot
            inverse[j, i] = dot


@kernel()
def _go(
    damping: Floats,
    step: Floats,
    residual: Floats,
    direction: Floats,
    product: Floats,
    slope: Floats,
    worth: Floats,
    running: Flags,
    rounds: NDArray[np.int64],
    unknowns: tuple[int, ...],
) -> None:
    blocks = step.shape[1]
    for p in range(len(step)):
        if not running[p]:
            continue
        bend = slope[p] * 0
        for i in range(blocks):
            for c in range(len(unknowns)):
                product[p, i, c] += damping[p, i, c] * direction[p, i, c]
                bend += product[p, i, c] * direction[p, i, c]
        if not bend > 0:
            running[p] = False
            product[p] = 0
            continue
        rounds[p] += 1
        length = slope[p] / bend
        for i in range(blocks):
            for c in range(len(unknowns)):
                step[p, i, c] += length * direction[p, i, c]
                residual[p, i, c] -= length * product[p, i, c]
        running[p] = length * slope[p] > worth[p]


@kernel()
def _precondition(
    preconditioner: Floats,
    residual: Floats,
    image: Floats,
    running: Flags,
    unknowns: tuple[int, ...],
) -> None:
    for p in range(len(residual)):
        for i in range(residual.shape[1] if running[p] else 0):
            for c in range(len(unknowns)):
                image[p, i, c] = 0
            for e in range(len(unknowns)):
                for c in range(len(unknowns)):
                    image[p, i, c] += preconditioner[p, i, e, c] * residual[p, i, e]


@kernel()
def _turn(
    residual: Floats,
    direction: Floats,
    image: Floats,
    slope: Floats,
    enough: Floats,
    running: Flags,
) -> None:
    for p in range(len(slope)):
        if not running[p]:
            continue
        before, now = slope[p], slope[p] * 0
        for i in range(residual.shape[1]):
            for c in range(residual.shape[2]):
                now += image[p, i, c] * residual[p, i, c]
        ratio = now / before if before > 0 else before * 0
        for i in range(residual.shape[1]):
            for c in range(residual.shape[2]):
                direction[p, i, c] = image[p, i, c] + ratio * direction[p, i, c]
                image[p, i, c] = 0
        slope[p] = now
        running[p] = now > enough[p]
