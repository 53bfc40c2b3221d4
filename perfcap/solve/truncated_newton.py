"""Damped Gauss-Newton for many unknowns a frame, each step by truncated conjugate gradients."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.bounds import Bounds
from perfcap.solve.coarse import CoarseCorrection, coarse_correction, find_coarse_space
from perfcap.solve.conjugate_gradient import Descent, conjugate_gradients
from perfcap.solve.damping import Damping
from perfcap.solve.energy import Objective, StateType, Step
from perfcap.solve.solution import Solution, Status
from perfcap.solve.sparse import CoarseSpace, Size, SparseEquations, evaluate, linearize

_LARGEST_DAMPING = 1e20
_FLOOR = 1e-6  # of the mean curvature, for unknowns that nothing sees
_STALE = 10.0  # growth of the damping after which the coarse correction is made anew


@dataclass(frozen=True)
class TruncatedNewton:
    """Settings of a damped, truncated Gauss-Newton method (Dembo and Steihaug 1983).

    For energies that offer ``linearize_blocks``. Every frame is a problem of its own, with its own
    damping and its own end: the energy, terms, steps and status of the solution are (*b, F).
    A step minimises the damped quadratic model only as well as it deserves, by conjugate
    gradients that never form a matrix. Robust kernels are reweighted; steps are judged by the true
    energy. Bounds are not supported.

    Args:
        max_steps: most steps tried, accepted or not.
        tolerance: a frame has converged when a step promises and brings a relative decrease of
            its energy below this. Raised to what the precision can resolve: 32 rounding units.
        damping: initial damping, relative to the diagonal of the curvature. It also holds back
            what costs nothing, such as the motion of a whole limb: keep it small.
        forcing: conjugate gradients end once their residual has fallen to this share.
        max_rounds: most products with the curvature a step.
    """

    max_steps: int = 10
    tolerance: float = 1e-3
    damping: float = 1e-6
    forcing: float = 0.1
    max_rounds: int = 100

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state; see ``solve``.

        Raises:
            InputError: there are bounds, frames share unknowns, or an energy offers no blocks.
        """
        if bounds is not None:
            raise InputError(
                "bounds were given, but TruncatedNewton has none; use LevenbergMarquardt, or "
                "leave them out"
            )
        with torch.no_grad():
            run = _start(self, objective, initial)
            for left in reversed(range(self.max_steps)):
                if not bool(run.running.any()):
                    break
                run = _advance(run, self, objective, final=left == 0)
        return run.solution()


@dataclass(frozen=True)
class _Run(Generic[StateType]):
    """Where every problem is; tensors are (P,).

    ``terms`` and ``energy`` belong to ``state``, and so do ``equations`` while a problem runs.
    ``coarse`` is kept from the first state on: it speeds up the search for a step and has no part
    in where that leads. ``smooth`` says that no step of the last round was rejected.
    """

    state: StateType
    size: Size
    equations: SparseEquations
    space: CoarseSpace | None
    coarse: CoarseCorrection | None
    coarse_damping: Tensor
    terms: dict[str, Tensor]
    energy: Tensor
    start_energy: Tensor
    damping: Damping
    steps: Tensor
    status: Tensor
    running: Tensor
    smooth: bool

    def solution(self) -> Solution[StateType]:
        return Solution.over_batch(
            self.size.frames, self.state, self.terms, self.steps, self.status
        )


@dataclass(frozen=True)
class _Trial(Generic[StateType]):
    """A tried step (P, M, q), where it leads, and what came of it, (P,)."""

    step: Tensor
    valid: Tensor
    state: StateType
    equations: SparseEquations | None
    terms: dict[str, Tensor]
    energy: Tensor
    promised: Tensor
    gained: Tensor
    accepted: Tensor


def _start(settings: TruncatedNewton, objective: Objective, state: StateType) -> _Run[StateType]:
    size = Size.of(state)
    equations = linearize(objective, state, size)
    finite, energy = equations.finite(), equations.energy
    status = torch.where(finite, Status.MAX_STEPS, Status.NOT_FINITE)
    return _Run(
        state=state,
        size=size,
        equations=equations,
        space=find_coarse_space(objective, state, size),
        coarse=None,
        coarse_damping=torch.zeros_like(energy),
        terms=equations.terms,
        energy=energy,
        start_energy=energy,
        damping=Damping.start(settings.damping, energy),
        steps=torch.zeros_like(status),
        status=status,
        running=finite,
        smooth=True,
    )


def _advance(
    run: _Run[StateType], settings: TruncatedNewton, objective: Objective, final: bool
) -> _Run[StateType]:
    """Try one step of every running problem; after the final one there are no equations."""
    damping = _diagonal_damping(run)
    coarse, coarse_damping = _coarse(run, damping)
    run = replace(run, coarse=coarse, coarse_damping=coarse_damping)
    descent = conjugate_gradients(
        run.equations, damping, run.running, settings.forcing, settings.max_rounds, coarse
    )
    trial = _try(run, descent, settings, objective, final)
    status = _judge(run, trial, settings)
    rejected = run.running & ~trial.accepted
    moved = replace(
        run,
        damping=run.damping.update(run.running, trial.accepted, trial.gained / trial.promised),
        steps=run.steps + run.running,
        status=status,
        running=run.running & (status == Status.MAX_STEPS),
        smooth=not bool(rejected.any()),
    )
    return _move(moved, trial, objective, final) if bool(trial.accepted.any()) else moved


def _try(
    run: _Run[StateType],
    descent: Descent,
    settings: TruncatedNewton,
    objective: Objective,
    final: bool,
) -> _Trial[StateType]:
    """Evaluate the energy at the end of a step.

    While steps succeed the trial is linearized at once, which gives its energy too. After a
    rejected one it is only evaluated, until a step succeeds again; and so are steps that are
    likely to be the last.
    """
    valid = run.running & descent.step.isfinite().flatten(1).all(-1)
    step = torch.where(valid[:, None, None], descent.step, 0)
    state = _moved(run.state, step, run.size)
    little = descent.promised * (1 + run.damping.value) <= _enough(run, settings)
    equations = None
    if run.smooth and not final and not bool((little | ~run.running).all()):
        equations = linearize(objective, state, run.size)
    terms = equations.terms if equations else evaluate(objective, state, run.size)
    energy = torch.stack(list(terms.values())).sum(0)
    gained = run.energy - energy
    return _Trial(
        step=step,
        valid=valid,
        state=state,
        equations=equations,
        terms=terms,
        energy=energy,
        promised=descent.promised,
        gained=gained,
        accepted=valid & (gained > 0) & (descent.promised > 0),
    )


def _diagonal_damping(run: _Run[StateType]) -> Tensor:
    """What is added to the diagonal of the curvature, (P, M, q)."""
    diagonal = run.equations.diagonal.diagonal(dim1=-2, dim2=-1)
    floor = _FLOOR * diagonal.mean(-2, keepdim=True)  # of each unknown of a block, in its unit
    scale = diagonal + floor.clamp(min=torch.finfo(diagonal.dtype).tiny)
    return run.damping.value[:, None, None] * scale


def _coarse(run: _Run[StateType], damping: Tensor) -> tuple[CoarseCorrection | None, Tensor]:
    """The coarse correction and its damping, anew where it is far softer than what it corrects."""
    value, fresh = run.damping.value, run.coarse is not None
    if fresh:
        fresh = bool(((value <= _STALE * run.coarse_damping) | ~run.running).all())
    if run.space is None or fresh:
        return run.coarse, run.coarse_damping
    return coarse_correction(run.space, run.equations, damping), value


def _judge(run: _Run[StateType], trial: _Trial[StateType], settings: TruncatedNewton) -> Tensor:
    """New status of every problem.

    A short step under heavy damping is no sign of convergence, so promises are scaled up to what
    the undamped model could give. A rejected step counts only where its promise is below what the
    precision of the energy can show.
    """
    resolution = _resolution(run)
    promise, enough = trial.promised * (1 + run.damping.value), _enough(run, settings)
    converged = trial.valid & (
        (trial.accepted & (promise <= enough) & (trial.gained <= enough))
        | (trial.accepted & (trial.energy <= resolution**2 * run.start_energy))
        | (promise <= resolution * run.energy)
    )
    stuck = run.running & ~trial.accepted & (run.damping.value > _LARGEST_DAMPING)
    dead_end = torch.where(trial.energy.isfinite(), Status.STALLED, Status.NOT_FINITE)
    status = torch.where(stuck, dead_end, run.status)
    return torch.where(converged, Status.CONVERGED, status)


def _resolution(run: _Run[StateType]) -> float:
    """Relative change of an energy that its precision can show."""
    return 32 * torch.finfo(run.energy.dtype).eps


def _enough(run: _Run[StateType], settings: TruncatedNewton) -> Tensor:
    """Decrease below which a problem has converged, (P,)."""
    return max(settings.tolerance, _resolution(run)) * run.energy


def _move(
    run: _Run[StateType], trial: _Trial[StateType], objective: Objective, final: bool
) -> _Run[StateType]:
    """Go to the trial state where it was accepted, and have its equations."""
    accepted, state, equations = trial.accepted, trial.state, trial.equations
    if not run.smooth:
        step = torch.where(accepted[:, None, None], trial.step, 0)
        state, equations = _moved(run.state, step, run.size), None
    run = replace(
        run,
        state=state,
        terms={n: torch.where(accepted, trial.terms[n], run.terms[n]) for n in run.terms},
        energy=torch.where(accepted, trial.energy, run.energy),
    )
    if final or not bool(run.running.any()):
        return run
    equations = equations or linearize(objective, state, run.size)
    lost = run.running & accepted & ~equations.finite()
    return replace(
        run,
        equations=equations,
        status=torch.where(lost, Status.NOT_FINITE, run.status),
        running=run.running & ~lost,
    )


def _moved(state: StateType, step: Tensor, size: Size) -> StateType:
    """The end of a step (P, M, q)."""
    frame = step.reshape(*size.frames, -1)
    return state.retract(Step(frame, frame.new_zeros(*size.frames[:-1], 0)))
