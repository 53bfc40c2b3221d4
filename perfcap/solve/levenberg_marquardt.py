"""Batched, bounded Levenberg-Marquardt on the structured normal equations."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Generic, Self

import torch
from torch import Tensor

from perfcap.setting_checks import require_count, require_number, require_size
from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import Bounds, StepBox, step_box
from perfcap.solve.closed_forms import warn_of_contradictions
from perfcap.solve.damped_loop import Run, minimize
from perfcap.solve.damped_model import DampedModel, DampedStep, damping_scale
from perfcap.solve.energy import Objective, StateType
from perfcap.solve.layout import Layout
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.progress import ROUNDING, Outcome, Progress
from perfcap.solve.solution import Solution, Status
from perfcap.solve.soundness import require_sound

if TYPE_CHECKING:
    from perfcap.solve._step_room import Room
from typing import TYPE_CHECKING

from perfcap.geometry.plain import is_plain
from perfcap.solve.box_step import box_step
from perfcap.solve.damped_model import negligible_share
from perfcap.solve.factorization import factorize

# --- The minimiser of a damped model within the bounds, and what a method asks about it -----------
#
# A window solve spends a large part of its time between operations, so compiled loops do all of
# this in two calls, in memory that is allocated once a solve (``_step_room.Room``); the same in
# torch serves gradients, graphics cards and shared unknowns.


def room_for_steps(equations: NormalEquations) -> Room | None:
    """Memory for the steps of a whole solve, None where torch has to take them.

    Which of the two it is is settled here, once a solve.
    """
    tensors = [equations.curvature, equations.frame_gradient]
    for window in equations.windows:
        tensors += [window.jacobian, window.features, window.basis, window.plain_basis]
        tensors += [window.complement, window.keep]
    if equations.layout.shared_dim or not is_plain(*tensors):
        return None
    from perfcap.solve._step_room import Room

    return Room.of(equations)


def damped_step(model: DampedModel, room: Room | None = None) -> DampedStep:
    """Minimise the damped model over the box.

    Args:
        model: what to minimise.
        room: memory of this solve for compiled loops; they are used if it is given.
    """
    if room is not None:
        from perfcap.solve import _step_numba

        return _step_numba.damped_step(model, room)
    equations, damping = model.equations, model.damping()
    factorization = factorize(equations, damping)
    newton = factorization.newton_step(equations)
    valid = factorization.valid & newton.isfinite().all(-1)
    if not all(model.running):
        valid = valid & torch.tensor(model.running, device=valid.device)
    newton = torch.where(valid.unsqueeze(-1), newton, 0)
    step, multipliers = newton, model.multipliers
    if model.box is not None:
        warm = torch.where(valid.unsqueeze(-1), multipliers, 0)
        step, multipliers = box_step(equations, factorization, damping, newton, model.box, warm)
        valid = valid & step.isfinite().all(-1)
        step = torch.where(valid.unsqueeze(-1), step, 0)
    size, reach = ((model.scale * x.square()).sum(-1) for x in (step, model.at))
    return DampedStep(
        step=step,
        damping=damping,
        multipliers=multipliers,
        valid=valid,
        promised=equations.decrease(step),
        share=torch.where(model.here > 0, damping / model.here, 0).amax(-1),
        negligible=size <= negligible_share(step.dtype) * reach,
    )


# --- Batched, bounded Levenberg-Marquardt on the structured normal equations ----------------------

_UNDAMPED = 1e-6  # what is softer than this share of its own curvature is not determined


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

    def __post_init__(self) -> None:
        require_count(self.max_steps, "max_steps", least=0)
        require_number(self.tolerance, "tolerance", least=0)
        require_size(self.damping, "damping", finite=True)

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state within the bounds; see ``solve``."""
        with torch.no_grad():
            run = begin(self, objective, initial, bounds)
            found = minimize(run, self.max_steps)
            warn_of_contradictions(objective, found, run.first)
            return found


def begin(
    settings: LevenbergMarquardt, objective: Objective, state: StateType, bounds: Bounds | None
) -> Run[StateType, DampedStep]:
    """A run at its initial state.

    Raises:
        InputError: an energy without closed derivatives is not what they are found for.
    """
    require_sound(objective, state)
    equations = assemble(objective, state)
    finite, layout = equations.finite(), equations.layout
    model: _StructuredModel[StateType] = _StructuredModel(
        objective=objective,
        layout=layout,
        box=step_box(bounds, state, layout),
        room=room_for_steps(equations),
        equations=equations.where(finite, equations.zeros()),
    )
    fresh = _DecrementProgress(settings.damping, settings.tolerance)
    return Run.start(layout.batch, model, state, equations.terms, finite, fresh)


@dataclass(frozen=True)
class _StructuredModel(Generic[StateType]):
    """Normal equations, finite in any case, that are factorized; a ``LinearModel``.

    ``box`` holds the bounds as seen from some state. ``room`` is memory that the steps share; None
    where torch takes them. ``before`` (B, N) is the largest scale of the unknowns until here.
    """

    objective: Objective
    layout: Layout
    box: StepBox | None
    room: Room | None
    equations: NormalEquations
    before: Tensor | None = None

    @cached_property
    def here(self) -> Tensor:
        """Scale of the unknowns at the state, (B, N)."""
        return damping_scale(self.equations)

    @cached_property
    def scale(self) -> Tensor:
        """The largest so far, which a damping of one adds to the diagonal, (B, N)."""
        return self.here if self.before is None else torch.maximum(self.before, self.here)

    def at(self, state: StateType) -> Self:
        return replace(self, equations=assemble(self.objective, state), before=self.scale)

    def evaluate(self, state: StateType) -> dict[str, Tensor]:
        report = self.objective.report(state)
        return {name: self.layout.per_element(value) for name, value in report.items()}

    def retract(self, state: StateType, step: Tensor) -> StateType:
        return state.retract(self.layout.unflatten(step))

    def merge(self, moved: Tensor, stayed: Self, state: StateType) -> Self:
        return replace(self, equations=self.equations.where(moved, stayed.equations))

    def propose(self, run: Run[StateType, DampedStep], final: bool) -> DampedStep:
        """The exact minimum of the damped model within the bounds."""
        at = self.layout.flatten(run.state.coordinates())
        model = DampedModel(
            equations=self.equations,
            value=[each.damping for each in run.progress],
            undamped=[each.undamped for each in run.progress],
            running=run.running,
            here=self.here,
            scale=self.scale,
            at=at,
            box=None if self.box is None else replace(self.box, at=at),
            multipliers=torch.zeros_like(at) if run.last is None else run.last.multipliers,
        )
        return damped_step(model, self.room)


@dataclass(frozen=True)
class _DecrementProgress(Progress):
    """Progress that ends by what an undamped step promises.

    A step under damping may promise little although much is left to gain, so small promises alone
    say nothing. An element has converged when a step with no damping to speak of, within bounds,
    promises less than the tolerance. That number is the Newton decrement of the model: it does not
    depend on the units of the unknowns, and it bounds the scale-free first-order test, since moving
    unknown i alone already promises ``(J_i'r)^2 / |J_i|^2 = cos_i^2 |r|^2``.

    ``back`` is the damping to return to when an undamped step is tried to see whether anything is
    left to gain, else None. ``refused`` says that such a step was tried here and led nowhere.
    """

    back: float | None = None
    refused: bool = False

    @property
    def undamped(self) -> bool:
        return self.back is not None

    def after(self, outcome: Outcome, eps: float) -> Self:
        moved = super().after(outcome, eps)
        undecided = moved.running and not self.undamped and not moved.refused
        if undecided and self._promises_little(outcome, eps):
            return replace(moved, damping=min(moved.damping, _softest(eps)), back=moved.damping)
        return moved

    def takes(self, outcome: Outcome, eps: float) -> bool:
        # also the last Newton step, which the energy is too coarse to show
        level = outcome.valid and abs(outcome.gained) <= ROUNDING * eps * outcome.before
        return outcome.accepted or (self.status is Status.CONVERGED and level)

    def _converged(self, outcome: Outcome, eps: float) -> bool:
        undamped = self.undamped or outcome.damping <= _softest(eps)
        return undamped and self._promises_little(outcome, eps)

    def _stuck(self, outcome: Outcome, eps: float) -> bool:
        unseen = outcome.valid and outcome.promised <= ROUNDING * eps * outcome.before
        return (unseen and self.refused) or super()._stuck(outcome, eps)

    def _promises_little(self, outcome: Outcome, eps: float) -> bool:
        worth = max(self.tolerance, ROUNDING * eps) * outcome.before
        surprise = outcome.accepted and outcome.gained > worth
        return outcome.valid and (outcome.negligible or outcome.promised <= worth) and not surprise

    def _accept(self, outcome: Outcome) -> Self:
        return replace(super()._accept(outcome), back=None, refused=False)

    def _reject(self) -> Self:
        """More damping, or what it was before an undamped step was tried."""
        if self.back is not None:
            return replace(self, damping=self.back, back=None, refused=True)
        return super()._reject()


def _softest(eps: float) -> float:
    """Damping that is none to speak of, in a precision with rounding unit ``eps``."""
    return max(_UNDAMPED, math.sqrt(eps))
