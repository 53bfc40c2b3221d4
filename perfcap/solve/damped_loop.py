"""The loop of damped Gauss-Newton methods: linearize, damp, step, judge, move.

It knows nothing of matrices. What is linear and how it is minimised is a ``LinearModel``: normal
equations, factorized within bounds (``levenberg_marquardt.py``), or products with a sparse matrix
and conjugate gradients (``truncated_newton.py``). A ``Progress`` says when an element ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, Self, TypeVar

import torch
from torch import Tensor

from perfcap.solve.energy import StateType, total
from perfcap.solve.progress import Outcome, Progress
from perfcap.solve.solution import Solution, Status


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """The minimiser of a damped model and what is known of it before it is taken.

    Args:
        step: zero where none was found, and for elements that no longer run, (B, N).
        valid: whether a step was found, (B,).
        promised: decrease of the energy by the model without its damping, (B,).
        share: the largest share of an unknown's curvature here that was added to it, (B,).
        negligible: whether the step is rounding of the unknowns, (B,).
        leads_on: whether the model at its end will likely be wanted; after the last step it is
            not made where not.
    """

    step: Tensor
    valid: Tensor
    promised: Tensor
    share: Tensor
    negligible: Tensor
    leads_on: bool = True


StepType = TypeVar("StepType", bound=Proposal)


class Equations(Protocol):
    """What a linear model knows of its objective at a state."""

    @property
    def terms(self) -> dict[str, Tensor]:
        """Energies by name, (B,)."""

    def finite(self) -> Tensor:
        """Whether everything about an element is, (B,)."""


class LinearModel(Protocol[StateType, StepType]):
    """The quadratic model of an objective at a state, B of them side by side."""

    @property
    def equations(self) -> Equations:
        """At the state."""

    def at(self, state: StateType) -> Self:
        """The model at another state."""

    def merge(self, moved: Tensor, stayed: Self, state: StateType) -> Self:
        """This model where an element has moved, (B,), and the other one for those that stayed;
        ``state`` is where they all are now.
        """

    def evaluate(self, state: StateType) -> dict[str, Tensor]:
        """Energies by name at another state, (B,)."""

    def retract(self, state: StateType, step: Tensor) -> StateType:
        """Where steps (B, N) lead."""

    def propose(self, run: Run[StateType, StepType], final: bool) -> StepType:
        """Minimise the model of a run, damped; ``final`` if nothing follows."""


@dataclass(frozen=True)
class Run(Generic[StateType, StepType]):
    """Where every element of a ``batch`` is; B is their number.

    ``terms`` and ``energy`` (B,) belong to ``state``; ``first`` is the energy of the initial one.
    ``model`` belongs to it too while an element runs. ``last`` is what was proposed last, to start
    warm. ``smooth`` says that no step of the last round was rejected.
    """

    batch: torch.Size
    state: StateType
    model: LinearModel[StateType, StepType]
    terms: dict[str, Tensor]
    energy: Tensor
    first: list[float]
    progress: tuple[Progress, ...]
    last: StepType | None = None
    smooth: bool = True

    @classmethod
    def start(
        cls,
        batch: torch.Size,
        model: LinearModel[StateType, StepType],
        state: StateType,
        terms: dict[str, Tensor],
        finite: Tensor,
        fresh: Progress,
    ) -> Self:
        """A run at its initial state, with the energies there, (B,), and where all is finite."""
        energy, lost = total(terms), fresh.ended(Status.NOT_FINITE)
        progress = tuple(fresh if good else lost for good in finite.tolist())
        return cls(batch, state, model, terms, energy, energy.tolist(), progress)

    @property
    def running(self) -> list[bool]:
        """Which elements go on."""
        return [each.running for each in self.progress]

    def solution(self) -> Solution[StateType]:
        """What has been found."""
        device = self.energy.device
        steps = torch.tensor([each.steps for each in self.progress], device=device)
        status = torch.tensor([int(each.status) for each in self.progress], device=device)
        return Solution.over_batch(self.batch, self.state, self.terms, steps, status)


@dataclass(frozen=True)
class Trial(Generic[StateType, StepType]):
    """A tried step, where it leads, and what came of it, (B,).

    ``model`` is that of ``state`` if it was linearized. ``progress`` is what follows for every
    element, and ``taken`` says which go there.
    """

    found: StepType
    state: StateType
    model: LinearModel[StateType, StepType] | None
    terms: dict[str, Tensor]
    energy: Tensor
    taken: list[bool]
    progress: tuple[Progress, ...]

    @property
    def accepted(self) -> Tensor:
        """``taken`` beside the energies, (B,)."""
        return torch.tensor(self.taken, device=self.energy.device)


def minimize(run: Run[StateType, StepType], max_steps: int) -> Solution[StateType]:
    """Advance a run to its end."""
    for _, after in advance(run, max_steps):
        run = after
    return run.solution()


def advance(
    run: Run[StateType, StepType], max_steps: int
) -> Iterator[tuple[Trial[StateType, StepType], Run[StateType, StepType]]]:
    """Trials and the runs after them, until every element has ended."""
    for left in reversed(range(max_steps)):
        if not any(run.running):
            return
        trial = _try(run, final=left == 0)
        run = _follow(run, trial, final=left == 0)
        yield trial, run


def _try(run: Run[StateType, StepType], final: bool) -> Trial[StateType, StepType]:
    """Minimise the damped model and find the energy there.

    While steps succeed the trial is linearized at once, which gives its energy too. After a
    rejected one it is only evaluated, until a step succeeds again; and so are steps that are likely
    to be the last.
    """
    found = run.model.propose(run, final)
    state = run.model.retract(run.state, found.step)
    model = run.model.at(state) if run.smooth and found.leads_on else None
    terms = run.model.evaluate(state) if model is None else model.equations.terms
    energy = total(terms)
    eps = torch.finfo(energy.dtype).eps
    outcomes = _outcomes(run, found, energy)
    progress = tuple(
        each.after(outcome, eps) for each, outcome in zip(run.progress, outcomes, strict=True)
    )
    taken = [each.takes(outcome, eps) for each, outcome in zip(progress, outcomes, strict=True)]
    return Trial(found, state, model, terms, energy, taken, progress)


def _outcomes(run: Run[Any, Any], found: Proposal, energy: Tensor) -> tuple[Outcome, ...]:
    """What came of steps that lead to energies (B,), brought to the host at once."""
    flags = found.valid.to(energy), found.negligible.to(energy)
    rows = torch.stack((found.share, found.promised, run.energy, energy, *flags), -1).tolist()
    return tuple(
        Outcome(share, bool(valid), promise, before - after, before, after, first, bool(tiny))
        for (share, promise, before, after, valid, tiny), first in zip(rows, run.first, strict=True)
    )


def _follow(
    run: Run[StateType, StepType], trial: Trial[StateType, StepType], final: bool
) -> Run[StateType, StepType]:
    """Go to the trial state where it was accepted, and have the model there if anything follows."""
    smooth = all(taken or not on for taken, on in zip(trial.taken, run.running, strict=True))
    run = replace(run, progress=trial.progress, last=trial.found, smooth=smooth)
    if not any(trial.taken):
        return run
    accepted, state = trial.accepted, trial.state
    if not smooth:
        step = torch.where(accepted.unsqueeze(-1), trial.found.step, 0)
        state = run.model.retract(run.state, step)
    run = replace(
        run,
        state=state,
        terms={n: torch.where(accepted, trial.terms[n], run.terms[n]) for n in run.terms},
        energy=torch.where(accepted, trial.energy, run.energy),
    )
    if not any(run.running) or (final and not trial.found.leads_on):
        return run
    model = run.model.at(state) if trial.model is None else trial.model
    finite = model.equations.finite()
    good = finite.tolist()
    progress = tuple(
        each.ended(Status.NOT_FINITE) if each.running and taken and not kept else each
        for each, taken, kept in zip(run.progress, trial.taken, good, strict=True)
    )
    if not all(taken and kept for taken, kept in zip(trial.taken, good, strict=True)):
        model = model.merge(accepted & finite, run.model, state)
    return replace(run, model=model, progress=progress)
