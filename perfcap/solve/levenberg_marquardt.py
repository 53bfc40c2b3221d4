"""Batched, bounded Levenberg-Marquardt on the structured normal equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import torch
from torch import Tensor

from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import Bounds, StepBox, step_box
from perfcap.solve.box_step import BoxStep, box_step
from perfcap.solve.damping import Damping, damping_scale
from perfcap.solve.energy import Objective, StateType
from perfcap.solve.factorization import factorize
from perfcap.solve.layout import Layout
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.solution import Solution, Status

_LARGEST_DAMPING = 1e20


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Settings of the damped Gauss-Newton method (Levenberg 1944, Marquardt 1963).

    Args:
        max_steps: most steps tried, accepted or not.
        tolerance: an element has converged when an undamped step promises a relative decrease of
            the energy below this. Raised to what the precision can resolve: 32 rounding units.
        step_tolerance: it has also converged when the step is below this times
            (1 + largest coordinate), for energies that end at zero.
        damping: initial damping, relative to the curvature of the data.
    """

    max_steps: int = 50
    tolerance: float = 1e-6
    step_tolerance: float = 1e-10
    damping: float = 1e-3

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state within the bounds; see ``solve``."""
        with torch.no_grad():
            run = _Run.start(self, objective, initial)
            for _ in range(self.max_steps):
                if not bool(run.running.any()):
                    break
                run = _advance(run, self, objective, bounds)
        return run.solution()


@dataclass(frozen=True)
class _Run(Generic[StateType]):
    """Where every batch element is; tensors are (B,) unless said otherwise.

    ``equations`` are those of ``state``, but for elements that no longer run. ``terms`` belong to
    ``state``. ``multipliers`` (B, N) warm-start the bounds.
    """

    state: StateType
    layout: Layout
    start_energy: Tensor
    equations: NormalEquations
    terms: dict[str, Tensor]
    damping: Damping
    steps: Tensor
    status: Tensor
    running: Tensor
    multipliers: Tensor | None = None

    @classmethod
    def start(
        cls, settings: LevenbergMarquardt, objective: Objective, state: StateType
    ) -> _Run[StateType]:
        equations = assemble(objective, state)
        finite = equations.finite()
        energy = equations.energy
        status = torch.full_like(energy, Status.MAX_STEPS, dtype=torch.long)
        return cls(
            state=state,
            layout=equations.layout,
            start_energy=energy,
            equations=equations.where_finite(finite),
            terms=equations.terms,
            damping=Damping.start(settings.damping, energy),
            steps=torch.zeros_like(status),
            status=torch.where(finite, status, Status.NOT_FINITE),
            running=finite,
        )

    @property
    def energy(self) -> Tensor:
        return torch.stack(list(self.terms.values())).sum(0)

    def solution(self) -> Solution[StateType]:
        def batched(values: Tensor) -> Tensor:
            return values.reshape(self.layout.batch)

        terms = {name: batched(value) for name, value in self.terms.items()}
        return Solution(
            self.state, batched(self.energy), terms, batched(self.steps), batched(self.status)
        )


def _advance(
    run: _Run[StateType], settings: LevenbergMarquardt, objective: Objective, bounds: Bounds | None
) -> _Run[StateType]:
    """Try one step of every running element."""
    layout = run.layout
    box = step_box(bounds, run.state, layout)
    found, valid = _damped_step(run, box)
    step = torch.where(run.running.unsqueeze(-1) & valid.unsqueeze(-1), found.step, 0)
    trial = run.state.retract(layout.unflatten(step))
    terms = {name: layout.per_element(v) for name, v in objective.report(trial).items()}
    energy = torch.stack(list(terms.values())).sum(0)
    promised = run.equations.decrease(step)
    gained = run.energy - energy
    accepted = run.running & valid & (gained > 0) & (promised > 0)
    status = _judge(run, settings, step, valid, promised, gained, accepted, energy)
    running = run.running & (status == Status.MAX_STEPS)
    moved = replace(
        run,
        steps=run.steps + run.running,
        status=status,
        running=running,
        damping=run.damping.update(accepted, gained / promised),
        multipliers=found.multipliers,
    )
    if not bool(accepted.any()):
        return moved
    if not bool(accepted[run.running].all()) or not bool(run.running.all()):
        trial = run.state.retract(layout.unflatten(torch.where(accepted.unsqueeze(-1), step, 0)))
    terms = {name: torch.where(accepted, terms[name], run.terms[name]) for name in terms}
    moved = replace(moved, state=trial, terms=terms)
    return _linearize(moved, objective) if bool(running.any()) else moved


def _damped_step(run: _Run[StateType], box: StepBox | None) -> tuple[BoxStep, Tensor]:
    """The step of the damped model within the box, and whether it is usable (B,)."""
    damping = run.damping.value.unsqueeze(-1) * damping_scale(run.equations)
    factorization = factorize(run.equations, damping)
    if box is None:
        step = factorization.newton_step(run.equations)
        found = BoxStep(step, torch.zeros_like(step))
    else:
        found = box_step(run.equations, factorization, damping, box, run.multipliers)
    return found, factorization.valid & found.step.isfinite().all(-1)


def _judge(
    run: _Run[StateType],
    settings: LevenbergMarquardt,
    step: Tensor,
    valid: Tensor,
    promised: Tensor,
    gained: Tensor,
    accepted: Tensor,
    energy: Tensor,
) -> Tensor:
    """New status of every element.

    A short step under heavy damping is no sign of convergence, so promises and steps are scaled
    up to what the undamped model could give: at most (1 + damping) times as much. A rejected step
    counts only where the promise is below what the precision of the energy can show.
    """
    resolution = 32 * torch.finfo(step.dtype).eps
    undamped = 1 + run.damping.value
    promise = promised * undamped
    tolerance = max(settings.tolerance, resolution)
    size = step.abs().amax(-1) * undamped
    at = run.layout.flatten(run.state.coordinates()).abs().amax(-1)
    converged = accepted & (promise <= tolerance * run.energy) & (gained <= tolerance * run.energy)
    converged = converged | (valid & (promise <= resolution * run.energy))
    converged = converged | (accepted & (energy <= resolution**2 * run.start_energy))
    converged = converged | (valid & (size <= settings.step_tolerance * (1 + at)))
    stuck = ~accepted & (run.damping.value > _LARGEST_DAMPING)
    end = torch.where(energy.isfinite(), Status.STALLED, Status.NOT_FINITE)
    status = torch.where(run.running & stuck, end, run.status)
    return torch.where(run.running & converged, Status.CONVERGED, status)


def _linearize(run: _Run[StateType], objective: Objective) -> _Run[StateType]:
    """Equations at the new state; elements whose derivatives are not finite end there."""
    equations = assemble(objective, run.state)
    finite = equations.finite()
    status = torch.where(run.running & ~finite, Status.NOT_FINITE, run.status)
    return replace(
        run,
        equations=equations.where_finite(finite),
        status=status,
        running=run.running & finite,
    )
