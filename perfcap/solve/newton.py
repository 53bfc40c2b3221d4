"""Newton's method with exact second derivatives, from where another method has ended.

Gauss-Newton's matrix is all that most solves need. Where residuals at the minimum are large, or an
energy is no sum of squares, it leads there slowly, and a gradient through the solve is that of the
minimum: a few steps on the true Hessian, which ``Implicit`` needs in any case, get there.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from perfcap.setting_checks import require_count, require_number
from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import Bounds, step_box
from perfcap.solve.energy import Objective, StateType, total
from perfcap.solve.implicit_step import free_unknowns, invert
from perfcap.solve.layout import Layout
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.progress import ROUNDING
from perfcap.solve.solution import Method, Solution, Status
from perfcap.solve.stationarity import hessian

_DAMPING = (0.0, *(10.0**power for power in range(-3, 10)))  # of the curvature of the data


@dataclass(frozen=True)
class Newton:
    """Another method, and then steps on the true Hessian within the bounds.

    A step is damped as much as it takes for the matrix to be positive and the energy to fall.

    Args:
        first: what leads near the minimum.
        max_steps: most steps after it, each of which costs the second derivatives of all energies.
        tolerance: an element has converged when a step promises a relative decrease of the energy
            below this, or below what the precision can resolve.
    """

    first: Method = field(default_factory=LevenbergMarquardt)
    max_steps: int = 20
    tolerance: float = 1e-14

    def __post_init__(self) -> None:
        require_count(self.max_steps, "max_steps", least=0)
        require_number(self.tolerance, "tolerance", least=0)

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state within the bounds; see ``solve``."""
        found = self.first.minimize(objective, initial, bounds)
        with torch.no_grad():
            return self._polished(objective, found, bounds)

    def _polished(
        self, objective: Objective, found: Solution[StateType], bounds: Bounds | None
    ) -> Solution[StateType]:
        state, layout = found.state, Layout.of(found.state)
        status, steps = found.status.reshape(-1).clone(), found.steps.reshape(-1).clone()
        running, first = status != Status.NOT_FINITE, found.energy.reshape(-1)
        for _ in range(self.max_steps):
            if not bool(running.any()):
                break
            equations = assemble(objective, state)
            running = running & equations.finite()
            state, moved, promised = _step(objective, state, equations, bounds, running)
            before = total(equations.terms)
            level = ROUNDING * torch.finfo(before.dtype).eps
            worth = max(self.tolerance, level) * before + level**2 * first
            done = running & (promised <= worth)
            status = torch.where(done, int(Status.CONVERGED), status)
            steps = steps + running.to(steps)
            running = running & moved & ~done
        report = objective.report(state)
        terms = {name: layout.per_element(value) for name, value in report.items()}
        return Solution.over_batch(layout.batch, state, terms, steps, status)


def _step(
    objective: Objective,
    state: StateType,
    equations: NormalEquations,
    bounds: Bounds | None,
    wanting: Tensor,
) -> tuple[StateType, Tensor, Tensor]:
    """The state after a step, which elements moved (B,), and what their steps promised (B,)."""
    layout, slope = equations.layout, equations.gradient()
    exact = hessian(objective, state, equations)
    free = free_unknowns(state, bounds, slope, layout)
    box = step_box(bounds, state, layout)
    before = total(equations.terms)
    taken = torch.zeros_like(slope)
    promised, moved = torch.full_like(before, torch.inf), torch.zeros_like(wanting)
    for share in _DAMPING:
        inverse = invert(exact, equations, free, wanting, share)
        step = -inverse.solve(slope)
        step = step if box is None else box.clamp(step)
        # half the energy's slope: what is left of it is as much as a whole step gains
        gain = -(slope * step).sum(-1)
        report = objective.report(state.retract(layout.unflatten(step)))
        after = layout.per_element(total(report))
        level = ROUNDING * torch.finfo(after.dtype).eps * before
        falls = wanting & (after <= before + level) & (gain >= 0)
        taken = torch.where(falls.unsqueeze(-1), step, taken)
        promised, moved = torch.where(falls, gain, promised), moved | falls
        wanting = wanting & ~falls
        if not bool(wanting.any()):
            break
    return state.retract(layout.unflatten(taken)), moved, promised
