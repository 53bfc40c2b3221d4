"""What the entry to all minimisers asks of one."""

from __future__ import annotations

from typing import Protocol

from perfcap.solve.bounds import Bounds
from perfcap.solve.energy import Objective, StateType
from perfcap.solve.solution import Solution


class Method(Protocol):
    """A minimiser: a value that holds settings and nothing else."""

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state that is within the bounds and carries no gradient."""
