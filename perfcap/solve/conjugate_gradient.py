"""Truncated, block-Jacobi preconditioned conjugate gradients over many problems at once."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import torch
from torch import Tensor

from perfcap.geometry.plain import is_plain
from perfcap.solve.coarse import CoarseCorrection
from perfcap.solve.search import Search
from perfcap.solve.sparse_problem import SparseEquations


@dataclass(frozen=True)
class Descent:
    """An inexact minimum of the damped quadratic models.

    Args:
        step: where it is, (P, M, q).
        promised: the decrease of the energy that the undamped model promises there, (P,).
        rounds: products with the matrix it took, (P,).
    """

    step: Tensor
    promised: Tensor
    rounds: Tensor


def conjugate_gradients(
    equations: SparseEquations,
    damping: Tensor,
    running: Tensor,
    worth: Tensor,
    forcing: float,
    limit: int,
    coarse: CoarseCorrection | None = None,
) -> Descent:
    """Solve ``(H + diag(damping)) d = -g`` of each problem, roughly (Dembo and Steihaug 1983).

    Args:
        equations: H and g of P problems.
        damping: (P, M, q), positive.
        running: problems to solve; the others keep a step of zero, (P,).
        worth: a problem ends after a round that lowers its model by less than this, (P,).
        forcing: a problem ends once its residual, measured by the preconditioner, is below this
            times what it was.
        limit: most rounds.
        coarse: second level of the preconditioner.
    """
    search = _start(equations, damping, running, worth)
    rounds = _twin(search.step).Rounds(search)
    rounds.precondition()
    for count in range(limit + 1):
        if coarse is not None:
            coarse.add(search.residual, search.product, search.running)
        rounds.turn()
        if count == 0:
            search.enough.copy_(forcing**2 * search.slope)
        if count == limit or not bool(search.running.any()):
            break
        for curvature in equations.curvatures:
            curvature.add_product(search.direction, search.product, search.running)
        rounds.go()
    step = search.step
    # H d = -g - residual - damping d, so that no further product is needed
    undamped = damping * step + search.residual - equations.gradient
    return Descent(step, (step * undamped).sum((-2, -1)), search.rounds)


def _start(equations: SparseEquations, damping: Tensor, running: Tensor, worth: Tensor) -> Search:
    """At a step of zero, without a direction yet."""
    residual = torch.where(running[:, None, None], -equations.gradient, 0)
    preconditioner = torch.empty_like(equations.diagonal)
    _twin(residual).invert(equations.diagonal, damping, running, preconditioner)
    none = torch.zeros_like(equations.energy)
    return Search(
        damping=damping,
        preconditioner=preconditioner,
        step=torch.zeros_like(residual),
        residual=residual,
        direction=torch.zeros_like(residual),
        product=torch.zeros_like(residual),
        slope=none,
        enough=none.clone(),
        worth=worth,
        running=running.clone(),
        rounds=torch.zeros_like(running, dtype=torch.int64),
    )


def _twin(like: Tensor) -> ModuleType:
    """Compiled loops on the CPU, torch on GPUs."""
    if is_plain(like):
        from perfcap.solve import _search_numba

        return _search_numba
    from perfcap.solve import _search_torch

    return _search_torch
