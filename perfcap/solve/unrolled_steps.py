"""Levenberg-Marquardt steps that are recorded, and taken again as differentiable functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import torch
from torch import Tensor

from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import Bounds
from perfcap.solve.damped_loop import advance
from perfcap.solve.energy import Objective, StateType
from perfcap.solve.factorization import factorize
from perfcap.solve.implicit_step import ReducedInverse, attach, restrict
from perfcap.solve.layout import Layout
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt, begin
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.solution import Sensitivity, Solution


@dataclass(frozen=True)
class RecordedStep(Generic[StateType]):
    """A step (B, N) from a state, zero where it was not taken.

    ``damping`` is what was added to the diagonal, (B, N), and ``held`` says which coordinates
    bounds held, (B, N).
    """

    start: StateType
    step: Tensor
    damping: Tensor
    held: Tensor
    taken: Tensor


@dataclass(frozen=True)
class Record(Generic[StateType]):
    """Steps in their order, and what they led to."""

    steps: tuple[RecordedStep[StateType], ...]
    solution: Solution[StateType]


def record(
    objective: Objective, initial: StateType, settings: LevenbergMarquardt, bounds: Bounds | None
) -> Record[StateType]:
    """Minimise, keeping every step that was taken by any element."""
    run, kept = begin(settings, objective, initial, bounds), []
    for trial, after in advance(run, settings.max_steps):
        taken = trial.accepted
        if bool(taken.any()):
            found = trial.found
            step, held = torch.where(taken.unsqueeze(-1), found.step, 0), found.multipliers != 0
            kept.append(RecordedStep(run.state, step, found.damping, held, taken))
        run = after
    return Record(tuple(kept), run.solution())


def replay(
    objective: Objective,
    steps: tuple[RecordedStep[StateType], ...],
    bounds: Bounds | None,
    good: Tensor,
    last: int | None = None,
) -> StateType:
    """Take recorded steps again; the state they lead to carries the graph of the last ones.

    Damping and the bounds that act are constants of the record. A step d is where
    ``r(d) = g + (H + damping) d`` vanishes on the free coordinates, so its derivative is
    ``- (H + damping)^-1 dr``, and is attached as that.

    Args:
        objective: the energies.
        steps: at least one.
        bounds: as recorded.
        good: elements that are differentiated, (B,); the others are constants.
        last: how many of each element's steps are differentiated; all if None.
    """
    taken = torch.stack([step.taken for step in steps])  # steps B
    left = taken.long().flip(0).cumsum(0).flip(0)
    wanted = good & taken & (left <= (len(steps) if last is None else last))
    first = int(wanted.any(-1).to(torch.uint8).argmax())
    state = steps[first].start
    layout = Layout.of(state)
    for recorded, differs in zip(steps[first:], wanted[first:].unsqueeze(-1), strict=True):
        equations = assemble(objective, state)
        here = layout.flatten(state.coordinates())
        step = recorded.step
        if bounds is not None:
            # a coordinate that is held moves to its bound from wherever it is
            step = torch.where(recorded.held & differs, (here.detach() + step) - here, step)
        rows = equations.gradient() + equations.apply(step) + recorded.damping * step
        inverse = _inverse(equations, recorded, differs)
        correction = attach(torch.where(differs, rows, 0), inverse)
        state = state.retract(layout.unflatten(step + correction))
    return state


def _inverse(
    equations: NormalEquations, recorded: RecordedStep[StateType], taken: Tensor
) -> ReducedInverse:
    free = (taken & ~recorded.held).to(recorded.step)
    with torch.no_grad():
        plain = equations.where(taken.squeeze(-1), equations.zeros()).detach()
        factorization = factorize(restrict(plain, free), free * recorded.damping)
    kind = torch.full_like(recorded.taken, Sensitivity.GAUSS_NEWTON, dtype=torch.long)
    return ReducedInverse(factorization, free, kind)
