"""Damped Gauss-Newton for many unknowns a frame, each step by truncated conjugate gradients."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, Self

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.setting_checks import require_count, require_number
from perfcap.solve.bounds import Bounds
from perfcap.solve.coarse import CoarseCorrection, coarse_correction
from perfcap.solve.coarse_space import CoarseSpace
from perfcap.solve.conjugate_gradient import conjugate_gradients
from perfcap.solve.damped_loop import Proposal, Run, minimize
from perfcap.solve.energy import Objective, StateType, Step
from perfcap.solve.progress import ROUNDING, Outcome, Progress
from perfcap.solve.solution import Solution
from perfcap.solve.sparse_problem import SparseEquations, SparseProblem

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

    def __post_init__(self) -> None:
        for name in ("max_steps", "max_rounds"):
            require_count(getattr(self, name), name, least=0)
        for name in ("tolerance", "damping", "forcing"):
            require_number(getattr(self, name), name, least=0)

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
            problem = SparseProblem.of(objective, initial)
            equations, space = problem.linearize(initial), problem.coarse_space(initial)
            model = _SparseModel(self, problem, space, initial, equations)
            fresh = _TruncatedProgress(self.damping, self.tolerance, forcing=self.forcing)
            terms, finite = equations.terms, equations.finite()
            run = Run.start(problem.frames, model, initial, terms, finite, fresh)
            return minimize(run, self.max_steps)


@dataclass(frozen=True, kw_only=True)
class _TruncatedProgress(Progress):
    """Progress that has converged once a step leaves little: no further one has to show it."""

    forcing: float

    def _converged(self, outcome: Outcome, eps: float) -> bool:
        """Newton's method leaves about what its model got wrong; conjugate gradients the square of
        what their residual fell to. A rejected step counts only where its promise is below what the
        precision of the energy can show.
        """
        # what an undamped step could give: a short one under damping is no sign of convergence
        promise = outcome.promised * (1 + outcome.damping)
        left = abs(promise - outcome.gained) + self.forcing**2 * promise
        little = outcome.accepted and left <= self.tolerance * outcome.before
        return outcome.valid and (little or promise <= ROUNDING * eps * outcome.before)


@dataclass(frozen=True, kw_only=True)
class _TruncatedStep(Proposal):
    """What conjugate gradients came to, and the preconditioner's second level.

    The correction is kept from the first state on: it speeds up the search for a step and has no
    part in where that leads. ``made_at`` are the dampings it was made for, P numbers.
    """

    coarse: CoarseCorrection | None
    made_at: list[float]


@dataclass(frozen=True)
class _SparseModel(Generic[StateType]):
    """A matrix known by its products, and conjugate gradients; a ``LinearModel`` of P frames."""

    settings: TruncatedNewton
    problem: SparseProblem
    space: CoarseSpace | None
    state: StateType
    equations: SparseEquations

    def at(self, state: StateType) -> Self:
        return replace(self, state=state, equations=self.problem.linearize(state))

    def evaluate(self, state: StateType) -> dict[str, Tensor]:
        return self.problem.evaluate(state)

    def retract(self, state: StateType, step: Tensor) -> StateType:
        frames = self.problem.frames
        return state.retract(Step(step.reshape(*frames, -1), step.new_zeros(*frames[:-1], 0)))

    def merge(self, moved: Tensor, stayed: Self, state: StateType) -> Self:
        """Linearized anew, where it was not there: sums of products have no elements."""
        return self if self.state is state else self.at(state)

    def propose(self, run: Run[StateType, _TruncatedStep], final: bool) -> _TruncatedStep:
        """The minimum of the damped model as well as it deserves, by conjugate gradients."""
        settings, limits = self.settings, (self.settings.forcing, self.settings.max_rounds)
        running = torch.tensor(run.running, device=run.energy.device)
        value = run.energy.new_tensor([each.damping for each in run.progress])
        damping = self._diagonal_damping(value)
        coarse, made_at = self._coarse(run, damping)
        worth = _WORTH * settings.tolerance * run.energy
        found = conjugate_gradients(self.equations, damping, running, worth, *limits, coarse)
        valid = running & found.promised.isfinite()  # and so is the step it was summed over
        worthy = running & (found.promised * (1 + value) > _LAST * settings.tolerance * run.energy)
        return _TruncatedStep(
            step=torch.where(valid[:, None, None], found.step, 0).flatten(1),
            valid=valid,
            promised=found.promised,
            share=value,
            negligible=torch.zeros_like(valid),
            leads_on=not final and bool(worthy.any()),
            coarse=coarse,
            made_at=made_at,
        )

    def _diagonal_damping(self, value: Tensor) -> Tensor:
        """What dampings (P,) add to the diagonal of the curvature, (P, M, q)."""
        diagonal = self.equations.diagonal.diagonal(dim1=-2, dim2=-1)
        mean = diagonal.mean(-2, keepdim=True)  # of each unknown of a block, in its unit
        # what no block sees anywhere does not move: any scale will do
        scale = diagonal + torch.where(mean > 0, _FLOOR * mean, 1)
        return value[:, None, None] * scale

    def _coarse(
        self, run: Run[StateType, _TruncatedStep], damping: Tensor
    ) -> tuple[CoarseCorrection | None, list[float]]:
        """The coarse corrections, anew for problems far softer than when they were made."""
        now, last = [each.damping for each in run.progress], run.last
        if self.space is None:
            return None, now
        if last is None or last.coarse is None:
            return coarse_correction(self.space, self.equations, damping), now
        pairs = list(zip(now, last.made_at, strict=True))
        stale = [
            on and new > _STALE * old for (new, old), on in zip(pairs, run.running, strict=True)
        ]
        if not any(stale):
            return last.coarse, last.made_at
        # only where stale: what another problem goes through must not change a step of this one
        anew = coarse_correction(self.space, self.equations, damping).inverse
        mask = torch.tensor(stale, device=anew.device)
        inverse = torch.where(mask[:, None, None], anew, last.coarse.inverse)
        made_at = [new if late else old for (new, old), late in zip(pairs, stale, strict=True)]
        return replace(last.coarse, inverse=inverse), made_at
