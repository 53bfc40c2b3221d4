"""Where a search by conjugate gradients is, shared by compiled loops and torch."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Search:
    """Conjugate gradients under way; every tensor is written in place.

    Args:
        damping: what is added to the diagonal of the matrix, (P, M, q).
        preconditioner: inverses of the damped diagonal blocks, (P, M, q, q).
        step: sum of what was gone so far, (P, M, q).
        residual: what is left of the right side there, (P, M, q).
        direction: to go next, (P, M, q).
        product: H direction, without the damping, then the preconditioned residual; zero between
            rounds, (P, M, q).
        slope: preconditioned square of the residual, (P,).
        enough: slope at which a problem ends, (P,).
        worth: decrease of the model in a round below which a problem ends, (P,).
        running: problems that have not ended, (P,).
        rounds: rounds that problems ran, (P,).
    """

    damping: Tensor
    preconditioner: Tensor
    step: Tensor
    residual: Tensor
    direction: Tensor
    product: Tensor
    slope: Tensor
    enough: Tensor
    worth: Tensor
    running: Tensor
    rounds: Tensor
