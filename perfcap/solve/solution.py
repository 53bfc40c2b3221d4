"""What the entry to all minimisers asks of one, and what a solve returns."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Generic, Protocol

import torch
from torch import Tensor

from perfcap.solve.bounds import Bounds
from perfcap.solve.energy import Objective, StateType, total


class Status(enum.IntEnum):
    """How a batch element ended; ``sentence`` says it in words."""

    CONVERGED = 0
    MAX_STEPS = 1
    STALLED = 2
    NOT_FINITE = 3

    @property
    def sentence(self) -> str:
        """One sentence: what happened and what to do."""
        return _SENTENCES[self]


class Sensitivity(enum.IntEnum):
    """What the gradient of a batch element's state is."""

    ZERO = 0  # the solve failed, or nothing could be inverted
    EXACT = 1  # of the minimum, with the full Hessian
    GAUSS_NEWTON = 2  # with Gauss-Newton's matrix: chosen, or the Hessian was not positive definite
    DAMPED = 3  # the same, damped: some unknowns were not determined
    UNROLLED = 4  # of the last steps


_SENTENCES = {
    Status.CONVERGED: "converged: the model promises no further decrease worth a step",
    Status.MAX_STEPS: "stopped at the largest number of steps while still improving; "
    "raise max_steps if the energy matters to the last digit",
    Status.STALLED: "stalled: no step lowers the energy although its derivative promises so; "
    "compare closed forms with perfcap.solve.forward_mode(energy, state), or loosen the tolerance "
    "in float32",
    Status.NOT_FINITE: "met a value that is not finite; the state is the last finite one, "
    "look for NaN or infinity in the detections, the cameras or the initial state",
}


@dataclass(frozen=True)
class Solution(Generic[StateType]):
    """Result of a solve. All is detached from the graph, but for a state that was asked for.

    Args:
        state: the unknowns found, always within the bounds.
        energy: total energy of each batch element, (*b,).
        terms: each energy's share by name, (*b,).
        steps: steps tried, (*b,) integers.
        status: ``Status`` values, (*b,) integers.
        sensitivity: ``Sensitivity`` values of a state that carries a graph, (*b,) integers; None
            if it carries none.
    """

    state: StateType
    energy: Tensor
    terms: dict[str, Tensor]
    steps: Tensor
    status: Tensor
    sensitivity: Tensor | None = None

    @classmethod
    def over_batch(
        cls,
        batch: torch.Size,
        state: StateType,
        terms: dict[str, Tensor],
        steps: Tensor,
        status: Tensor,
    ) -> Solution[StateType]:
        """A solution from tensors (B,) over the flattened batch."""
        terms = {name: value.reshape(batch) for name, value in terms.items()}
        return cls(state, total(terms), terms, steps.reshape(batch), status.reshape(batch))

    def describe(self) -> list[str]:
        """A sentence for each batch element, in the order of the flattened batch."""
        status = self.status.reshape(-1).tolist()
        steps = self.steps.reshape(-1).tolist()
        energy = self.energy.reshape(-1).tolist()
        rows = zip(status, steps, energy, strict=True)
        return [
            f"element {index}: {Status(code).sentence} ({count} steps, energy {value:.6g})"
            for index, (code, count, value) in enumerate(rows)
        ]


# --- What the entry to all minimisers asks of one -------------------------------------------------


class Method(Protocol):
    """A minimiser: a value that holds settings and nothing else."""

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state that is within the bounds and carries no gradient."""
