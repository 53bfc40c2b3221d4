"""Levenberg-Marquardt steps that are recorded, and taken again as differentiable functions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import torch
from torch import Tensor

from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import Bounds, step_box
from perfcap.solve.box_step import box_step
from perfcap.solve.damping import Damping, damping_scale
from perfcap.solve.energy import Objective, StateType
from perfcap.solve.factorization import factorize
from perfcap.solve.implicit_step import ReducedInverse, attach, restrict
from perfcap.solve.layout import Layout
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.solution import Sensitivity, Solution, Status


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
    """Minimise, keeping every step that was taken by any element.

    The same method as ``LevenbergMarquardt.minimize``, written for keeping rather than for speed;
    it ends at a relative decrease below ``settings.tolerance``.
    """
    run, kept = _start(objective, initial, settings), []
    for _ in range(settings.max_steps):
        if not bool(run.running.any()):
            break
        move = _try(run, bounds)
        run, taken = _judge(run, move, objective, settings)
        if taken is not None:
            kept.append(taken)
    found = Solution.over_batch(
        run.equations.layout.batch, run.state, run.equations.terms, run.steps, run.status
    )
    return Record(tuple(kept), found)


@dataclass(frozen=True)
class _Run(Generic[StateType]):
    """Where every element is; tensors are (B,)."""

    state: StateType
    equations: NormalEquations
    damping: Damping
    steps: Tensor
    status: Tensor
    running: Tensor


def _start(objective: Objective, state: StateType, settings: LevenbergMarquardt) -> _Run[StateType]:
    equations = assemble(objective, state)
    finite = equations.finite()
    equations = equations.where(finite, equations.zeros())
    status = torch.where(finite, Status.MAX_STEPS, Status.NOT_FINITE)
    damping = Damping.start(settings.damping, equations.energy)
    return _Run(state, equations, damping, torch.zeros_like(status), status, finite)


def _judge(
    run: _Run[StateType],
    move: RecordedStep[StateType],
    objective: Objective,
    settings: LevenbergMarquardt,
) -> tuple[_Run[StateType], RecordedStep[StateType] | None]:
    """Go where the energy fell; the step as it was taken, None if no element took it."""
    before, layout = run.equations, run.equations.layout
    after = assemble(objective, run.state.retract(layout.unflatten(move.step)))
    promised, gained = before.decrease(move.step), before.energy - after.energy
    taken = move.taken & after.finite() & (gained > 0) & (promised > 0)
    enough = max(settings.tolerance, 32 * torch.finfo(gained.dtype).eps)
    small = promised * (1 + run.damping.value) <= enough * before.energy
    converged = run.running & small & (taken | ~(gained > 0))
    step = torch.where(taken.unsqueeze(-1), move.step, 0)
    moved = replace(
        run,
        state=run.state.retract(layout.unflatten(step)),
        equations=after.where(taken, before),
        damping=run.damping.update(run.running, taken, gained / promised),
        steps=run.steps + run.running,
        status=torch.where(converged, Status.CONVERGED, run.status),
        running=run.running & ~converged,
    )
    return moved, replace(move, step=step, taken=taken) if bool(taken.any()) else None


def _try(run: _Run[StateType], bounds: Bounds | None) -> RecordedStep[StateType]:
    """The minimum of the damped model within the bounds; ``taken`` where there is one."""
    equations = run.equations
    added = run.damping.value.unsqueeze(-1) * damping_scale(equations)
    factorization = factorize(equations, added)
    step = factorization.newton_step(equations)
    valid = run.running & factorization.valid & step.isfinite().all(-1)
    step = torch.where(valid.unsqueeze(-1), step, 0)
    held = torch.zeros_like(step, dtype=torch.bool)
    box = step_box(bounds, run.state, equations.layout)
    if box is not None:
        step, multipliers = box_step(equations, factorization, added, step, box)
        held = multipliers != 0
    return RecordedStep(run.state, step, added, held, valid)


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
