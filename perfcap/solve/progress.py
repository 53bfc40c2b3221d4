"""How far one batch element has come: its damping, and what a tried step says about its end.

A step under damping may promise little although much is left to gain, so small promises alone say
nothing. An element has converged when a step with no damping to speak of, within the bounds,
promises less than the tolerance. That number is the Newton decrement of the model: it does not
depend on the units of the unknowns, and it bounds the scale-free first-order test, since moving
unknown i alone already promises ``(J_i'r)^2 / |J_i|^2 = cos_i^2 |r|^2``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from perfcap.solve.damping import GROWTH, LEAST
from perfcap.solve.solution import Status

_LARGEST = 1e20
_UNDAMPED = 1e-6  # what is softer than this share of its own curvature is not determined
_ROUNDING = 32  # units in the last place that a sum of squares may be off


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

    def level(self, eps: float) -> bool:
        """Whether the energy is the same but for rounding."""
        return self.valid and abs(self.gained) <= _ROUNDING * eps * self.before


@dataclass(frozen=True)
class Progress:
    """Where an element is.

    ``back`` is the damping to return to when an undamped step is tried to see whether anything is
    left to gain, else None. ``refused`` says that such a step was tried here and led nowhere.
    """

    damping: float
    growth: float = GROWTH
    steps: int = 0
    status: Status = Status.MAX_STEPS
    running: bool = True
    back: float | None = None
    refused: bool = False

    def after(self, outcome: Outcome, tolerance: float, eps: float) -> Progress:
        """Progress after a tried step, with ``eps`` the rounding unit."""
        if not self.running:
            return self
        counted = replace(self, steps=self.steps + 1)
        end = self._end(outcome, tolerance, eps)
        if end is not None:
            return replace(counted, status=end, running=False)
        moved = counted._accept(outcome) if outcome.accepted else counted._reject()
        undecided = self.back is None and not moved.refused
        if undecided and self._promises_little(outcome, tolerance, eps):
            return replace(moved, damping=min(moved.damping, undamped(eps)), back=moved.damping)
        return moved

    def _end(self, outcome: Outcome, tolerance: float, eps: float) -> Status | None:
        resolution = _ROUNDING * eps
        if outcome.accepted and outcome.after <= resolution**2 * outcome.first:
            return Status.CONVERGED
        little = self._promises_little(outcome, tolerance, eps)
        if little and (self.back is not None or outcome.damping <= undamped(eps)):
            return Status.CONVERGED
        if outcome.accepted:
            return None
        unseen = outcome.valid and outcome.promised <= resolution * outcome.before
        if (unseen and self.refused) or self.damping > _LARGEST:
            return Status.STALLED if math.isfinite(outcome.after) else Status.NOT_FINITE
        return None

    @staticmethod
    def _promises_little(outcome: Outcome, tolerance: float, eps: float) -> bool:
        worth = max(tolerance, _ROUNDING * eps) * outcome.before
        surprise = outcome.accepted and outcome.gained > worth
        return outcome.valid and (outcome.negligible or outcome.promised <= worth) and not surprise

    def _accept(self, outcome: Outcome) -> Progress:
        """Nielsen's (1999) update: down to a third, or up to twofold after a poor step."""
        fall = 1 - (2 * outcome.gained / outcome.promised - 1) ** 3
        damping = max(self.damping * min(max(fall, 1 / 3), 2.0), LEAST)
        return replace(self, damping=damping, growth=GROWTH, back=None, refused=False)

    def _reject(self) -> Progress:
        """More damping, 4, 8, 16, ... times; or what it was before an undamped step was tried."""
        if self.back is not None:
            return replace(self, damping=self.back, back=None, refused=True)
        return replace(self, damping=self.damping * self.growth, growth=2 * self.growth)


def undamped(eps: float) -> float:
    """Damping that is none to speak of, in a precision with rounding unit ``eps``."""
    return max(_UNDAMPED, math.sqrt(eps))
