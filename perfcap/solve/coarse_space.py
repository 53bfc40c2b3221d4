"""Motions that cost little, which local steps find slowly."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class CoarseSpace:
    """Motions of groups of blocks that cost an energy little.

    Args:
        group: group 0 ... C - 1 of each block, -1 for none, (M,).
        groups: C.
        modes: how a block moves along each of the r motions of its group, (*b, F, M, q, r), or
            (P, M, q, r) inside the solver.
    """

    group: Tensor
    groups: int
    modes: Tensor
