"""Damped Gauss-Newton for many unknowns a frame, each step by truncated conjugate gradients."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.bounds import Bounds
from perfcap.solve.coarse import CoarseCorrection, coarse_correction
from perfcap.solve.conjugate_gradient import Descent, conjugate_gradients
from perfcap.solve.damping import Damping
from perfcap.solve.energy import Objective, StateType, Step
from perfcap.solve.solution import Solution, Status
from perfcap.solve.sparse import CoarseSpace
from perfcap.solve.sparse_problem import SparseEquations, SparseProblem, total

_LARGEST_DAMPING = 1e20
_FLOOR = 1e-6  # of the mean curvature, for unknowns that nothing sees
_WORTH = 0.5  # of the tolerance, that a round of conjugate gradients must bring
_LAST = 10.0  # times the tolerance: a step that promises less is likely the last
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
        tolerance: a frame has converged when a step leaves less than this of its energy to gain:
            what the model got wrong of the step's gain, and what conjugate gradients left of it.
            It has also when a step promises less than the precision can show, 32 rounding units.
        damping: initial damping, relative to the diagonal of the curvature. It also holds back
            what costs nothing, such as the motion of a whole limb: keep it small.
        forcing: conjugate gradients end once their residual has fallen to this share, or a round
            of them brings less than half the tolerance.
        max_rounds: most products with the curvature a step.
    """

    max_steps: int = 10
    tolerance: float = 2e-3
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
            run = _start(self, SparseProblem.of(objective, initial), initial)
            for left in reversed(range(self.max_steps)):
                if not bool(run.running.any()):
                    break
                run = _advance(run, self, final=left == 0)
        return run.solution()


@dataclass(frozen=True)
class _Run(Generic[StateType]):
    """Where every problem is; tensors are (P,).

    ``terms`` and ``energy`` belong to ``state``, and so do ``equations`` while a problem runs.
    ``coarse`` is kept from the first state on: it speeds up the search for a step and has no part
    in where that leads. ``smooth`` says that no step of the last round was rejected.
    """

    problem: SparseProblem
    state: StateType
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
            self.problem.frames, self.state, self.terms, self.steps, self.status
        )


@dataclass(frozen=True)
class _Trial(Generic[StateType]):
    """A tried step (P, M, q), where it leads, and what came of it, (P,).

    ``valid`` says whether a step was found. ``promise`` is what an undamped one could give: a
    short step under heavy damping is no sign of convergence.
    """

    step: Tensor
    valid: Tensor
    state: StateType
    equations: SparseEquations | None
    terms: dict[str, Tensor]
    energy: Tensor
    promise: Tensor
    gained: Tensor
    accepted: Tensor


def _start(settings: TruncatedNewton, problem: SparseProblem, state: StateType) -> _Run[StateType]:
    equations = problem.linearize(state)
    finite, energy = equations.finite(), equations.energy
    status = torch.where(finite, Status.MAX_STEPS, Status.NOT_FINITE)
    return _Run(
        problem=problem,
        state=state,
        equations=equations,
        space=problem.coarse_space(state),
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


def _advance(run: _Run[StateType], settings: TruncatedNewton, final: bool) -> _Run[StateType]:
    """Try one step of every running problem; after the final one there are no equations."""
    damping = _diagonal_damping(run)
    coarse, coarse_damping = _coarse(run, damping)
    descent = conjugate_gradients(
        run.equations,
        damping,
        run.running,
        _WORTH * settings.tolerance * run.energy,
        settings.forcing,
        settings.max_rounds,
        coarse,
    )
    trial = _try(run, descent, settings, final)
    status = _judge(run, trial, settings)
    moved = replace(
        run,
        coarse=coarse,
        coarse_damping=coarse_damping,
        damping=run.damping.update(run.running, trial.accepted, trial.gained / descent.promised),
        steps=run.steps + run.running,
        status=status,
        running=run.running & (status == Status.MAX_STEPS),
        smooth=not bool((run.running & ~trial.accepted).any()),
    )
    return _move(moved, trial, final) if bool(trial.accepted.any()) else moved


def _diagonal_damping(run: _Run[StateType]) -> Tensor:
    """What is added to the diagonal of the curvature, (P, M, q)."""
    diagonal = run.equations.diagonal.diagonal(dim1=-2, dim2=-1)
    mean = diagonal.mean(-2, keepdim=True)  # of each unknown of a block, in its unit
    # what no block sees anywhere does not move: any scale will do
    scale = diagonal + torch.where(mean > 0, _FLOOR * mean, 1)
    return run.damping.value[:, None, None] * scale


def _coarse(run: _Run[StateType], damping: Tensor) -> tuple[CoarseCorrection | None, Tensor]:
    """The coarse corrections and their damping, anew for problems far softer than what they had."""
    value = run.damping.value
    if run.space is None:
        return None, run.coarse_damping
    if run.coarse is None:
        return coarse_correction(run.space, run.equations, damping), value
    stale = run.running & (value > _STALE * run.coarse_damping)
    if not bool(stale.any()):
        return run.coarse, run.coarse_damping
    # only where stale: what another problem goes through must not change a step of this one
    anew = coarse_correction(run.space, run.equations, damping).inverse
    inverse = torch.where(stale[:, None, None], anew, run.coarse.inverse)
    return replace(run.coarse, inverse=inverse), torch.where(stale, value, run.coarse_damping)


def _try(
    run: _Run[StateType], descent: Descent, settings: TruncatedNewton, final: bool
) -> _Trial[StateType]:
    """Evaluate the energy at the end of a step.

    While steps succeed the trial is linearized at once, which gives its energy too. After a
    rejected one it is only evaluated, until a step succeeds again; and so are steps that are
    likely to be the last.
    """
    valid = run.running & descent.promised.isfinite()  # and so is the step it was summed over
    step = torch.where(valid[:, None, None], descent.step, 0)
    state = _moved(run, step)
    promise = descent.promised * (1 + run.damping.value)
    worthy = run.running & (promise > _LAST * settings.tolerance * run.energy)
    equations = None
    if run.smooth and not final and bool(worthy.any()):
        equations = run.problem.linearize(state)
    terms = equations.terms if equations else run.problem.evaluate(state)
    energy = total(terms)
    gained = run.energy - energy
    return _Trial(
        step=step,
        valid=valid,
        state=state,
        equations=equations,
        terms=terms,
        energy=energy,
        promise=promise,
        gained=gained,
        accepted=valid & (gained > 0) & (promise > 0),
    )


def _judge(run: _Run[StateType], trial: _Trial[StateType], settings: TruncatedNewton) -> Tensor:
    """New status of every problem.

    Newton's method leaves about what its model got wrong; conjugate gradients the square of what
    their residual fell to. A rejected step counts only where its promise is below what the
    precision of the energy can show.
    """
    resolution, accepted = 32 * torch.finfo(run.energy.dtype).eps, trial.accepted
    left = (trial.promise - trial.gained).abs() + settings.forcing**2 * trial.promise
    converged = trial.valid & (
        (accepted & (left <= settings.tolerance * run.energy))
        | (accepted & (trial.energy <= resolution**2 * run.start_energy))
        | (trial.promise <= resolution * run.energy)
    )
    stuck = run.running & ~accepted & (run.damping.value > _LARGEST_DAMPING)
    dead_end = torch.where(trial.energy.isfinite(), Status.STALLED, Status.NOT_FINITE)
    status = torch.where(stuck, dead_end, run.status)
    return torch.where(converged, Status.CONVERGED, status)


def _move(run: _Run[StateType], trial: _Trial[StateType], final: bool) -> _Run[StateType]:
    """Go to the trial state where it was accepted, and have its equations."""
    accepted, state, equations = trial.accepted, trial.state, trial.equations
    if not run.smooth:
        state, equations = _moved(run, torch.where(accepted[:, None, None], trial.step, 0)), None
    run = replace(
        run,
        state=state,
        terms={n: torch.where(accepted, trial.terms[n], run.terms[n]) for n in run.terms},
        energy=torch.where(accepted, trial.energy, run.energy),
    )
    if final or not bool(run.running.any()):
        return run
    equations = equations or run.problem.linearize(state)
    lost = run.running & accepted & ~equations.finite()
    return replace(
        run,
        equations=equations,
        status=torch.where(lost, Status.NOT_FINITE, run.status),
        running=run.running & ~lost,
    )


def _moved(run: _Run[StateType], step: Tensor) -> StateType:
    """The end of a step (P, M, q)."""
    frames = run.problem.frames
    shared = step.new_zeros(*frames[:-1], 0)
    return run.state.retract(Step(step.reshape(*frames, -1), shared))
