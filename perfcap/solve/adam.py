"""First-order descent on the same objectives, for energies whose Jacobians are of no use."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Generic

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.setting_checks import require_count, require_number, require_size
from perfcap.solve.bounds import Bounds, StepBox, step_box
from perfcap.solve.energy import Objective, StateType, total
from perfcap.solve.layout import Layout
from perfcap.solve.solution import Solution, Status
from perfcap.solve.soundness import require_residuals


@dataclass(frozen=True)
class Adam:
    """Settings of Adam (Kingma and Ba 2015) in the tangent space of the state.

    The gradient is taken with respect to a step from the current state, so the moments live in
    its tangent coordinates. Bounds hold by clamping each step. The energy may rise on the way;
    the last state is returned, not the best one.

    Args:
        max_steps: most steps taken.
        learning_rate: size of a step, in the unit of the tangent coordinates; falls to zero along
            a half cosine.
        decay: decay of the first and of the second moment.
        tolerance: an element has converged when a step at the full learning rate promises a
            relative decrease of the energy below this.
    """

    max_steps: int = 300
    learning_rate: float = 0.02
    decay: tuple[float, float] = (0.9, 0.999)
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        require_count(self.max_steps, "max_steps", least=0)
        require_size(self.learning_rate, "learning_rate", finite=True)
        require_number(self.tolerance, "tolerance", least=0)
        if len(self.decay) != 2 or not all(0 <= share < 1 for share in self.decay):
            raise InputError(f"decay is {self.decay}; expected two numbers from 0 to below 1")

    def minimize(
        self, objective: Objective, initial: StateType, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state within the bounds; see ``solve``."""
        with torch.no_grad():
            run = _Run.start(objective, initial)
            box = step_box(bounds, initial, run.layout)
            for count in range(1, self.max_steps + 1):
                if not bool(run.running.any()):
                    break
                run = _advance(run, self, count, objective, box)
        return run.solution()


@dataclass(frozen=True)
class _Run(Generic[StateType]):
    """Where every batch element is: tensors (B,), the gradient and its moments (B, N)."""

    state: StateType
    layout: Layout
    terms: dict[str, Tensor]
    gradient: Tensor
    mean: Tensor
    square: Tensor
    steps: Tensor
    status: Tensor
    running: Tensor

    @classmethod
    def start(cls, objective: Objective, state: StateType) -> _Run[StateType]:
        layout = Layout.of(state)
        require_residuals(objective, state)
        terms, gradient = _evaluate(objective, state, layout)
        finite = total(terms).isfinite() & gradient.isfinite().all(-1)
        status = torch.where(finite, Status.MAX_STEPS, Status.NOT_FINITE)
        zero = torch.zeros_like(gradient)
        return cls(
            state, layout, terms, gradient, zero, zero, torch.zeros_like(status), status, finite
        )

    def solution(self) -> Solution[StateType]:
        return Solution.over_batch(
            self.layout.batch, self.state, self.terms, self.steps, self.status
        )


def _advance(
    run: _Run[StateType], settings: Adam, count: int, objective: Objective, box: StepBox | None
) -> _Run[StateType]:
    """Take one step with every running element."""
    first, second = settings.decay
    mean = first * run.mean + (1 - first) * run.gradient
    square = second * run.square + (1 - second) * run.gradient.square()
    spread = (square / (1 - second**count)).sqrt()
    direction = mean / (1 - first**count) / spread.clamp(min=torch.finfo(mean.dtype).tiny)
    full = -settings.learning_rate * direction
    step = 0.5 * (1 + math.cos(math.pi * (count - 1) / settings.max_steps)) * full
    if box is not None:
        box = box.at_state(run.state, run.layout)
        full, step = box.clamp(full), box.clamp(step)
    promise = -(run.gradient * full).sum(-1)
    converged = run.running & (promise.abs() <= settings.tolerance * total(run.terms))
    running = run.running & ~converged
    run = replace(
        run,
        mean=mean,
        square=square,
        status=torch.where(converged, Status.CONVERGED, run.status),
        steps=run.steps + running,
        running=running,
    )
    return _move(run, torch.where(running.unsqueeze(-1), step, 0), objective)


def _move(run: _Run[StateType], step: Tensor, objective: Objective) -> _Run[StateType]:
    """Go to the end of a step (B, N); elements that are not finite there go back and end."""
    state = run.state.retract(run.layout.unflatten(step))
    terms, gradient = _evaluate(objective, state, run.layout)
    finite = total(terms).isfinite() & gradient.isfinite().all(-1)
    lost = run.running & ~finite
    if bool(lost.any()):
        step = torch.where(lost.unsqueeze(-1), 0, step)
        state = run.state.retract(run.layout.unflatten(step))
    keep = run.running & finite
    return replace(
        run,
        state=state,
        terms={name: torch.where(keep, terms[name], run.terms[name]) for name in terms},
        gradient=torch.where(keep.unsqueeze(-1), gradient, 0),
        status=torch.where(lost, Status.NOT_FINITE, run.status),
        running=keep,
    )


def _evaluate(
    objective: Objective, state: StateType, layout: Layout
) -> tuple[dict[str, Tensor], Tensor]:
    """Energies by name (B,) and the gradient of their sum in the tangent space (B, N)."""
    zero = torch.zeros_like(layout.flatten(state.coordinates()))
    with torch.enable_grad():
        step = zero.requires_grad_()
        report = objective.report(state.retract(layout.unflatten(step)))
        terms = {name: layout.per_element(value) for name, value in report.items()}
        energy = total(terms).sum()
        # energies that are all constant are told of once, before the first step
        gradient = torch.autograd.grad(energy, step)[0] if energy.requires_grad else zero.detach()
    return {name: value.detach() for name, value in terms.items()}, gradient
