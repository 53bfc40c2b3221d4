"""How far one batch element of a damped method has come: its damping, its steps and its end."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

from perfcap.solve.solution import Status

ROUNDING = 32  # units in the last place that a sum of squares may be off
_GROWTH, _LEAST, _LARGEST = 4.0, 1e-16, 1e20


class Outcome(NamedTuple):
    """What came of a tried step.

    ``promised`` and ``gained`` are decreases of the energy, by the model without its damping and
    in truth; ``before`` and ``after`` the energies, ``first`` that of the initial state.
    ``damping`` is the largest share of an unknown's curvature here that was added to it.
    ``valid`` says whether a step was found, ``negligible`` whether it is rounding of the unknowns.
    """

    damping: float
    valid: bool
    promised: float
    gained: float
    before: float
    after: float
    first: float
    negligible: bool

    @property
    def accepted(self) -> bool:
        """Whether the energy fell, as the model said."""
        return self.valid and self.gained > 0 and self.promised > 0


@dataclass(frozen=True)
class Progress(ABC):
    """Where an element is; every method says by one of its own when an element has converged.

    ``tolerance`` is relative to the energy. ``growth`` is the factor that the next increase of the
    damping takes.
    """

    damping: float
    tolerance: float
    growth: float = _GROWTH
    steps: int = 0
    status: Status = Status.MAX_STEPS
    running: bool = True

    @property
    def undamped(self) -> bool:
        """Whether the next step is to be without damping to speak of."""
        return False

    def after(self, outcome: Outcome, eps: float) -> Self:
        """Progress after a tried step, with ``eps`` the rounding unit."""
        if not self.running:
            return self
        counted = replace(self, steps=self.steps + 1)
        end = self._end(outcome, eps)
        if end is not None:
            return counted.ended(end)
        return counted._accept(outcome) if outcome.accepted else counted._reject()

    def ended(self, status: Status) -> Self:
        """Where an element is that goes no further."""
        return replace(self, status=status, running=False)

    def takes(self, outcome: Outcome, eps: float) -> bool:
        """Whether the element goes along the step that led to this progress."""
        return outcome.accepted

    def _end(self, outcome: Outcome, eps: float) -> Status | None:
        nothing = (ROUNDING * eps) ** 2 * outcome.first
        if (outcome.accepted and outcome.after <= nothing) or self._converged(outcome, eps):
            return Status.CONVERGED
        if outcome.accepted or not self._stuck(outcome, eps):
            return None
        return Status.STALLED if math.isfinite(outcome.after) else Status.NOT_FINITE

    @abstractmethod
    def _converged(self, outcome: Outcome, eps: float) -> bool:
        """Whether too little is left to gain."""

    def _stuck(self, outcome: Outcome, eps: float) -> bool:
        """Whether no step leads on from where one was rejected."""
        return self.damping > _LARGEST

    def _accept(self, outcome: Outcome) -> Self:
        """Nielsen's (1999) update: down to a third, or up to twofold after a poor step."""
        gain = min(2 * outcome.gained / outcome.promised - 1, 1.0)  # its cube may overflow
        damping = max(self.damping * min(max(1 - gain**3, 1 / 3), 2.0), _LEAST)
        return replace(self, damping=damping, growth=_GROWTH)

    def _reject(self) -> Self:
        """More damping, 4, 8, 16, ... times."""
        return replace(self, damping=self.damping * self.growth, growth=2 * self.growth)
