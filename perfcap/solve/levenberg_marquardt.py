"""Batched, bounded Levenberg-Marquardt on the structured normal equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import torch
from torch import Tensor

from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import Bounds, StepBox, step_box
from perfcap.solve.box_step import box_step
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

    Robust kernels are reweighted: their slope at the last linearization scales the rows, and
    steps are judged by the true robust energy.

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
    damping: float = 0.1

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state within the bounds; see ``solve``."""
        with torch.no_grad():
            run = _start(self, objective, initial, bounds)
            for _ in range(self.max_steps):
                if not bool(run.running.any()):
                    break
                run = _advance(run, self, objective)
        return run.solution()


@dataclass(frozen=True)
class _Run(Generic[StateType]):
    """Where every batch element is; tensors are (B,) unless said otherwise.

    ``terms`` and ``energy`` belong to ``state``. ``equations`` do too while an element runs, and
    are finite in any case. ``multipliers`` (B, N) warm-start the bounds, which ``box`` holds as
    seen from some state. ``smooth`` says that no step of the last round was rejected.
    """

    state: StateType
    layout: Layout
    box: StepBox | None
    equations: NormalEquations
    terms: dict[str, Tensor]
    energy: Tensor
    start_energy: Tensor
    damping: Damping
    multipliers: Tensor
    steps: Tensor
    status: Tensor
    running: Tensor
    smooth: bool

    def solution(self) -> Solution[StateType]:
        return Solution.over_batch(
            self.layout.batch, self.state, self.terms, self.steps, self.status
        )


@dataclass(frozen=True)
class _Trial(Generic[StateType]):
    """A tried step (B, N), where it leads, and what came of it, (B,).

    ``valid`` says whether a step was found at all; the others are zero, as are those of elements
    that no longer run. ``equations`` are those of ``state`` if it was linearized.
    """

    step: Tensor
    multipliers: Tensor
    valid: Tensor
    state: StateType
    equations: NormalEquations | None
    terms: dict[str, Tensor]
    energy: Tensor
    promised: Tensor
    gained: Tensor
    accepted: Tensor


def _start(
    settings: LevenbergMarquardt, objective: Objective, state: StateType, bounds: Bounds | None
) -> _Run[StateType]:
    equations = assemble(objective, state)
    finite, energy = equations.finite(), equations.energy
    status = torch.where(finite, Status.MAX_STEPS, Status.NOT_FINITE)
    return _Run(
        state=state,
        layout=equations.layout,
        box=step_box(bounds, state, equations.layout),
        equations=equations.where(finite, equations.zeros()),
        terms=equations.terms,
        energy=energy,
        start_energy=energy,
        damping=Damping.start(settings.damping, energy),
        multipliers=torch.zeros_like(equations.gradient()),
        steps=torch.zeros_like(status),
        status=status,
        running=finite,
        smooth=True,
    )


def _advance(
    run: _Run[StateType], settings: LevenbergMarquardt, objective: Objective
) -> _Run[StateType]:
    """Try one step of every running element."""
    trial = _try(run, objective)
    status = _judge(run, trial, settings)
    rejected = run.running & ~trial.accepted
    moved = replace(
        run,
        damping=run.damping.update(run.running, trial.accepted, trial.gained / trial.promised),
        multipliers=trial.multipliers,
        steps=run.steps + run.running,
        status=status,
        running=run.running & (status == Status.MAX_STEPS),
        smooth=not bool(rejected.any()),
    )
    return _move(moved, trial, objective) if bool(trial.accepted.any()) else moved


def _try(run: _Run[StateType], objective: Objective) -> _Trial[StateType]:
    """Solve the damped model within the bounds and evaluate the energy at its minimum.

    While steps succeed the trial is linearized at once, which gives its energy too; after a
    rejected one it is only evaluated, until a step succeeds again.
    """
    layout = run.layout
    damping = run.damping.value.unsqueeze(-1) * damping_scale(run.equations)
    factorization = factorize(run.equations, damping)
    newton = factorization.newton_step(run.equations)
    valid = run.running & factorization.valid & newton.isfinite().all(-1)
    newton = torch.where(valid.unsqueeze(-1), newton, 0)
    step, multipliers = newton, run.multipliers
    if run.box is not None:
        box = run.box.at_state(run.state, layout)
        warm = torch.where(valid.unsqueeze(-1), multipliers, 0)
        step, multipliers = box_step(run.equations, factorization, damping, newton, box, warm)
        valid = valid & step.isfinite().all(-1)
        step = torch.where(valid.unsqueeze(-1), step, 0)
    state = run.state.retract(layout.unflatten(step))
    equations = assemble(objective, state) if run.smooth else None
    terms = equations.terms if equations is not None else _evaluate(objective, state, layout)
    energy = torch.stack(list(terms.values())).sum(0)
    promised, gained = run.equations.decrease(step), run.energy - energy
    accepted = valid & (gained > 0) & (promised > 0)
    return _Trial(
        step=step,
        multipliers=multipliers,
        valid=valid,
        state=state,
        equations=equations,
        terms=terms,
        energy=energy,
        promised=promised,
        gained=gained,
        accepted=accepted,
    )


def _evaluate(objective: Objective, state: StateType, layout: Layout) -> dict[str, Tensor]:
    """Energies by name, (B,)."""
    return {name: layout.per_element(value) for name, value in objective.report(state).items()}


def _judge(run: _Run[StateType], trial: _Trial[StateType], settings: LevenbergMarquardt) -> Tensor:
    """New status of every element.

    A short step under heavy damping is no sign of convergence, so promises and steps are scaled
    up to what the undamped model could give: at most (1 + damping) times as much. A rejected step
    counts only where the promise is below what the precision of the energy can show.
    """
    resolution = 32 * torch.finfo(trial.step.dtype).eps
    undamped = 1 + run.damping.value
    promise = trial.promised * undamped
    enough = max(settings.tolerance, resolution) * run.energy
    size = trial.step.abs().amax(-1) * undamped
    reach = 1 + run.layout.flatten(run.state.coordinates()).abs().amax(-1)
    converged = trial.valid & (
        (trial.accepted & (promise <= enough) & (trial.gained <= enough))
        | (trial.accepted & (trial.energy <= resolution**2 * run.start_energy))
        | (promise <= resolution * run.energy)
        | (size <= settings.step_tolerance * reach)
    )
    stuck = run.running & ~trial.accepted & (run.damping.value > _LARGEST_DAMPING)
    dead_end = torch.where(trial.energy.isfinite(), Status.STALLED, Status.NOT_FINITE)
    status = torch.where(stuck, dead_end, run.status)
    return torch.where(converged, Status.CONVERGED, status)


def _move(run: _Run[StateType], trial: _Trial[StateType], objective: Objective) -> _Run[StateType]:
    """Go to the trial state where it was accepted, and have its equations."""
    accepted, state = trial.accepted, trial.state
    if not run.smooth:
        step = torch.where(accepted.unsqueeze(-1), trial.step, 0)
        state = run.state.retract(run.layout.unflatten(step))
    run = replace(
        run,
        state=state,
        terms={n: torch.where(accepted, trial.terms[n], run.terms[n]) for n in run.terms},
        energy=torch.where(accepted, trial.energy, run.energy),
    )
    if not bool(run.running.any()):
        return run
    equations = trial.equations or assemble(objective, state)
    finite = equations.finite()
    lost = run.running & accepted & ~finite
    return replace(
        run,
        equations=equations.where(accepted & finite, run.equations),
        status=torch.where(lost, Status.NOT_FINITE, run.status),
        running=run.running & ~lost,
    )
