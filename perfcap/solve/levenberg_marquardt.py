"""Batched, bounded Levenberg-Marquardt on the structured normal equations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Generic

import torch
from torch import Tensor

from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import Bounds, StepBox, step_box
from perfcap.solve.damped_step import DampedModel, DampedStep, damped_step, room_for_steps
from perfcap.solve.damping import damping_scale
from perfcap.solve.energy import Objective, StateType
from perfcap.solve.layout import Layout
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.progress import Outcome, Progress
from perfcap.solve.solution import Solution, Status

if TYPE_CHECKING:
    from perfcap.solve._step_room import Room


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Settings of the damped Gauss-Newton method (Levenberg 1944, Marquardt 1963).

    Every unknown is damped by the largest curvature that the data have shown it (Moré 1978), and
    an element ends by what an undamped step promises: neither depends on the units of the
    unknowns. Robust kernels are reweighted: their slope at the last linearization scales the
    rows, and steps are judged by the true robust energy.

    ``LevenbergMarquardt(max_steps=1000, tolerance=0, damping=1e-2)`` goes on to the last digit.

    Args:
        max_steps: most steps tried, accepted or not.
        tolerance: an element has converged when an undamped step within the bounds promises a
            relative decrease of the energy below this; the cosine between the residual and any
            column of the Jacobian, over unknowns free to move, is then below its square root.
            Raised to what the precision can resolve: 32 rounding units.
        damping: initial damping, relative to the curvature of the data.
    """

    max_steps: int = 50
    tolerance: float = 1e-6
    damping: float = 0.1

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state within the bounds; see ``solve``."""
        with torch.no_grad():
            run = begin(self, objective, initial, bounds)
            for _, after in advance(self, run, objective):
                run = after
        return run.solution()


@dataclass(frozen=True)
class Run(Generic[StateType]):
    """Where every batch element is.

    ``terms`` and ``energy`` (B,) belong to ``state``; ``first`` is the energy of the initial one.
    ``equations`` belong to it too while an element runs, and are finite in any case. ``here``
    (B, N) is the scale of their unknowns, ``scale`` the largest so far: what a damping of one adds
    to the diagonal. ``multipliers`` (B, N) warm-start the bounds, which ``box`` holds as seen from
    some state. ``smooth`` says that no step of the last round was rejected. ``room`` is memory that
    the steps share; None where torch takes them.
    """

    state: StateType
    layout: Layout
    box: StepBox | None
    equations: NormalEquations
    here: Tensor
    scale: Tensor
    terms: dict[str, Tensor]
    energy: Tensor
    first: list[float]
    progress: tuple[Progress, ...]
    multipliers: Tensor
    smooth: bool
    room: Room | None

    @property
    def running(self) -> list[bool]:
        """Which elements go on."""
        return [each.running for each in self.progress]

    def solution(self) -> Solution[StateType]:
        """What has been found."""
        like, device = self.layout.batch, self.energy.device
        steps = torch.tensor([each.steps for each in self.progress], device=device)
        status = torch.tensor([int(each.status) for each in self.progress], device=device)
        return Solution.over_batch(like, self.state, self.terms, steps, status)


@dataclass(frozen=True)
class Trial(Generic[StateType]):
    """A tried step (B, N), where it leads, and what came of it, (B,).

    ``damping`` (B, N) was added to the diagonal. Steps are zero where none was found, and for
    elements that no longer run. ``equations`` are those of ``state`` if it was linearized.
    ``progress`` is what follows for every element, and ``taken`` says which go there: where the
    energy fell, or where it ends, the last Newton step, which the energy is too coarse to show.
    """

    step: Tensor
    damping: Tensor
    multipliers: Tensor
    state: StateType
    equations: NormalEquations | None
    terms: dict[str, Tensor]
    energy: Tensor
    taken: list[bool]
    progress: tuple[Progress, ...]
    smooth: bool

    @property
    def accepted(self) -> Tensor:
        """``taken`` beside the energies, (B,)."""
        return torch.tensor(self.taken, device=self.energy.device)


def begin(
    settings: LevenbergMarquardt, objective: Objective, state: StateType, bounds: Bounds | None
) -> Run[StateType]:
    """A run at its initial state."""
    equations = assemble(objective, state)
    finite = equations.finite()
    fresh = Progress(settings.damping)
    lost = replace(fresh, status=Status.NOT_FINITE, running=False)
    progress = tuple(fresh if good else lost for good in finite.tolist())
    terms, energy = equations.terms, equations.energy
    equations = equations.where(finite, equations.zeros())
    here = damping_scale(equations)
    return Run(
        state=state,
        layout=equations.layout,
        box=step_box(bounds, state, equations.layout),
        equations=equations,
        here=here,
        scale=here,
        terms=terms,
        energy=energy,
        first=energy.tolist(),
        progress=progress,
        multipliers=torch.zeros_like(equations.gradient()),
        smooth=True,
        room=room_for_steps(equations),
    )


def advance(
    settings: LevenbergMarquardt, run: Run[StateType], objective: Objective
) -> Iterator[tuple[Trial[StateType], Run[StateType]]]:
    """Trials and the runs after them, until every element has ended."""
    for _ in range(settings.max_steps):
        if not any(run.running):
            return
        trial = _try(run, objective, settings.tolerance)
        run = _follow(run, trial, objective)
        yield trial, run


def _try(run: Run[StateType], objective: Objective, tolerance: float) -> Trial[StateType]:
    """Solve the damped model within the bounds and evaluate the energy at its minimum.

    While steps succeed the trial is linearized at once, which gives its energy too; after a
    rejected one it is only evaluated, until a step succeeds again.
    """
    layout = run.layout
    at = layout.flatten(run.state.coordinates())
    model = DampedModel(
        equations=run.equations,
        value=[each.damping for each in run.progress],
        undamped=[each.back is not None for each in run.progress],
        running=run.running,
        here=run.here,
        scale=run.scale,
        at=at,
        box=None if run.box is None else replace(run.box, at=at),
        multipliers=run.multipliers,
    )
    found = damped_step(model, run.room)
    state = run.state.retract(layout.unflatten(found.step))
    equations = assemble(objective, state) if run.smooth else None
    terms = equations.terms if equations is not None else _evaluate(objective, state, layout)
    energy = torch.stack(list(terms.values())).sum(0)
    outcomes = _outcomes(run, found, energy)
    eps = torch.finfo(energy.dtype).eps
    progress = tuple(
        each.after(outcome, tolerance, eps)
        for each, outcome in zip(run.progress, outcomes, strict=True)
    )
    accepted = [
        outcome.accepted or (each.status is Status.CONVERGED and outcome.level(eps))
        for each, outcome in zip(progress, outcomes, strict=True)
    ]
    return Trial(
        step=found.step,
        damping=found.damping,
        multipliers=found.multipliers,
        state=state,
        equations=equations,
        terms=terms,
        energy=energy,
        taken=accepted,
        progress=progress,
        smooth=all(taken or not on for taken, on in zip(accepted, run.running, strict=True)),
    )


def _outcomes(run: Run[StateType], found: DampedStep, energy: Tensor) -> tuple[Outcome, ...]:
    """What came of steps that lead to energies (B,), brought to the host at once."""
    flags = found.valid.to(energy), found.negligible.to(energy)
    rows = torch.stack((found.share, found.promised, run.energy, energy, *flags), -1).tolist()
    return tuple(
        Outcome(share, bool(valid), promise, before - after, before, after, first, bool(tiny))
        for (share, promise, before, after, valid, tiny), first in zip(rows, run.first, strict=True)
    )


def _evaluate(objective: Objective, state: StateType, layout: Layout) -> dict[str, Tensor]:
    """Energies by name, (B,)."""
    return {name: layout.per_element(value) for name, value in objective.report(state).items()}


def _follow(run: Run[StateType], trial: Trial[StateType], objective: Objective) -> Run[StateType]:
    """Go to the trial state where it was accepted."""
    moved = replace(
        run, progress=trial.progress, multipliers=trial.multipliers, smooth=trial.smooth
    )
    return _move(moved, trial, objective) if any(trial.taken) else moved


def _move(run: Run[StateType], trial: Trial[StateType], objective: Objective) -> Run[StateType]:
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
    if not any(run.running):
        return run
    equations = trial.equations or assemble(objective, state)
    finite = equations.finite()
    good = finite.tolist()
    progress = tuple(
        replace(each, status=Status.NOT_FINITE, running=False)
        if each.running and taken and not kept
        else each
        for each, taken, kept in zip(run.progress, trial.taken, good, strict=True)
    )
    if not all(taken and kept for taken, kept in zip(trial.taken, good, strict=True)):
        equations = equations.where(accepted & finite, run.equations)
    here = damping_scale(equations)
    scale = torch.maximum(run.scale, here)
    return replace(run, equations=equations, here=here, scale=scale, progress=progress)
