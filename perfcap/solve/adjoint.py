"""How a solve is differentiated: not at all, at its solution, or step by step.

A solution x(theta) of a bounded minimisation, where theta is whatever the energies hold, has

    dx_F / dtheta = - H_FF^-1  d g_F / dtheta,      dx_A / dtheta = 0,

with the gradient g and the Hessian H of the energy, on the coordinates A that press against their
bounds and on all others, F (Fiacco 1976, under strict complementarity). H is block-diagonal but
for the low rank of the window energies and the border of shared unknowns, exactly as the normal
equations are, so this costs one more factorization.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, Literal

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.setting_checks import require_count, require_number
from perfcap.solve.assembly import assemble
from perfcap.solve.bounds import Bounds
from perfcap.solve.damped_model import added_damping, damping_scale
from perfcap.solve.energy import Objective, State, StateType
from perfcap.solve.implicit_step import (
    ReducedInverse,
    attach,
    finite_saved_numbers,
    free_unknowns,
    invert,
)
from perfcap.solve.layout import Layout
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt
from perfcap.solve.majorized import Majorized
from perfcap.solve.solution import Method, Sensitivity, Solution, Status
from perfcap.solve.stationarity import gradient, hessian
from perfcap.solve.unrolled_steps import record, replay

# --- The inverse of a Hessian that nobody writes down, by differences of exact gradients ----------

_ROUNDS = 200
_TOLERANCE = 1e-7  # of the residual, in the norm of the preconditioner
_REACH = 0.1  # m or rad: a difference moves no unknown by more than this times rounding^(1/3)


@dataclass(frozen=True)
class ProductInverse:
    """The inverse of half the Hessian on free coordinates, by conjugate gradients.

    A product with the Hessian is a central difference of the objective's gradient, which automatic
    differentiation gives exactly: energies whose second derivatives are not known, as those of
    rendered silhouettes, count as they are. Gauss-Newton's inverse preconditions. Where the Hessian
    turns out not to be positive, the best that was found on the way is returned.

    Args:
        base: inverse of Gauss-Newton's matrix.
        objective: what was minimised.
        state: the solution, without a graph.
        damping: added to the diagonal, (B, N).
    """

    base: ReducedInverse
    objective: Objective
    state: Any
    damping: Tensor

    @property
    def free(self) -> Tensor:
        """1 where a coordinate may move, else 0, (B, N)."""
        return self.base.free

    @property
    def sensitivity(self) -> Tensor:
        """What the inverse is of, ``Sensitivity`` values (B,)."""
        return self.base.sensitivity

    def solve(self, rows: Tensor) -> Tensor:
        """The inverse times rows (B, N)."""
        rest = torch.where(self.free > 0, rows, 0)
        found = torch.zeros_like(rest)
        conditioned = self.base.solve(rest)
        direction = conditioned
        power = (rest * conditioned).sum(-1)
        goal = _TOLERANCE**2 * power
        for _ in range(_ROUNDS):
            going = power > goal
            if not bool(going.any()):
                break
            product = self._product(direction)
            bend = (direction * product).sum(-1)
            going = going & (bend > 0)
            if not bool(going.any()):
                break
            length = torch.where(going, power / torch.where(bend > 0, bend, 1), 0).unsqueeze(-1)
            found, rest = found + length * direction, rest - length * product
            conditioned = self.base.solve(rest)
            renewed = (rest * conditioned).sum(-1)
            share = torch.where(going, renewed / power.clamp(min=1e-300), 0).unsqueeze(-1)
            direction = conditioned + share * direction
            power = torch.where(going, renewed, 0)
        return found

    def _product(self, direction: Tensor) -> Tensor:
        """Half the Hessian times rows (B, N), zero where they are not free."""
        reach = _REACH * torch.finfo(direction.dtype).eps ** (1 / 3)
        largest = direction.abs().amax(-1, keepdim=True).clamp(min=1e-300)
        step = reach / largest
        there, back = (
            tangent_gradient(self.objective, self.state, s * step * direction) for s in (1, -1)
        )
        product = 0.25 * (there - back) / step
        return torch.where(self.free > 0, product + self.damping * direction, 0)


def tangent_gradient(objective: Objective, state: State, rows: Tensor) -> Tensor:
    """Gradient of the energy in the tangent vector at a state, taken at rows (B, N)."""
    layout = Layout.of(state)
    with torch.enable_grad():
        step = rows.detach().requires_grad_()
        energy = objective(state.retract(layout.unflatten(step)))
        (slope,) = torch.autograd.grad(energy.sum(), step)
    return slope


# --- How a solve is differentiated: not at all, at its solution, or step by step ------------------

_EXACT = int(Sensitivity.EXACT)
_FAILED = (Status.STALLED, Status.NOT_FINITE)


class Adjoint(ABC):
    """How the state of a solution depends on what the energies hold."""

    @abstractmethod
    def solve(
        self, objective: Objective, initial: StateType, method: Method, bounds: Bounds | None
    ) -> Solution[StateType]:
        """Minimise from an initial state that is within the bounds and carries no gradient."""


@dataclass(frozen=True)
class Detached(Adjoint):
    """The solution is a constant."""

    def solve(  # noqa: D102
        self, objective: Objective, initial: StateType, method: Method, bounds: Bounds | None
    ) -> Solution[StateType]:
        return method.minimize(objective, initial, bounds)


@dataclass(frozen=True)
class Implicit(Adjoint):
    """Differentiate at the solution, by the implicit function theorem.

    Gradients reach everything that the energies hold and that requires one: detections,
    confidences, weights, cameras, bone lengths, masks. A coordinate that presses against its bound
    stays there, so its own gradient is zero; one that lies on its bound without pressing counts as
    free. Elements whose solve failed get a gradient of exactly zero, and ``Solution.sensitivity``
    says so. The gradient is that of the minimum: solve to a tolerance that deserves it.

    Args:
        hessian: "full" is exact at a minimum; "gauss_newton" leaves out second derivatives of
            residuals and kernels, is a little cheaper and always positive. Where the full Hessian
            is not positive definite, Gauss-Newton's takes its place.
            "products" never writes the Hessian down: conjugate gradients multiply by it, two
            gradients of the energies a product. It is exact for silhouettes too, whose second
            derivatives nobody has in closed form, and the choice for hundreds of unknowns a frame.
        damping: added to the Hessian, relative to the curvature of the data, to shorten gradients
            along what the data hardly see.
    """

    hessian: Literal["full", "gauss_newton", "products"] = "full"
    damping: float = 0.0

    def __post_init__(self) -> None:
        if self.hessian not in ("full", "gauss_newton", "products"):
            raise InputError(
                f"hessian is {self.hessian!r}; expected 'full', 'gauss_newton' or 'products'"
            )
        require_number(self.damping, "damping", least=0)

    def solve(  # noqa: D102
        self, objective: Objective, initial: StateType, method: Method, bounds: Bounds | None
    ) -> Solution[StateType]:
        solution = method.minimize(objective, initial, bounds)
        if not torch.is_grad_enabled():
            return solution
        state, layout = solution.state, Layout.of(solution.state)
        good = _solved(solution, layout)
        with finite_saved_numbers(good):
            rows = gradient(objective, state, layout)
        if not rows.requires_grad:
            return solution
        if self.hessian != "full":
            _require_residuals(objective, f"Implicit({self.hessian!r})")
        with torch.no_grad():
            inverse = self._inverse(objective, state, bounds, good)
        step = attach(torch.where(good.unsqueeze(-1), rows, 0), inverse)
        return replace(
            solution,
            state=state.retract(layout.unflatten(step)),
            sensitivity=inverse.sensitivity.reshape(layout.batch),
        )

    def _inverse(
        self, objective: Objective, state: StateType, bounds: Bounds | None, good: Tensor
    ) -> ReducedInverse | ProductInverse:
        equations = assemble(objective, state)
        good = good & equations.finite()
        exact = hessian(objective, state, equations) if self.hessian == "full" else None
        free = free_unknowns(state, bounds, equations.gradient(), equations.layout)
        inverse = invert(exact, equations, free, good, self.damping)
        if self.hessian != "products":
            return inverse
        kind = torch.where(inverse.sensitivity == Sensitivity.ZERO, Sensitivity.ZERO, _EXACT)
        ones = torch.ones_like(free[:, 0])
        added = self.damping * added_damping(ones, damping_scale(equations))
        return ProductInverse(replace(inverse, sensitivity=kind), objective, state, added)


@dataclass(frozen=True)
class Unrolled(Adjoint):
    """Differentiate the last steps of Levenberg-Marquardt, one by one.

    Costs the graphs of all these steps. It is the gradient of the numbers that were computed,
    converged or not; of a converged solve it tends to ``Implicit``'s as steps are added.

    Args:
        steps: how many of the last successful steps, all of them if None.
    """

    steps: int | None = 5

    def __post_init__(self) -> None:
        if self.steps is not None:
            require_count(self.steps, "steps")

    def solve(  # noqa: D102
        self, objective: Objective, initial: StateType, method: Method, bounds: Bounds | None
    ) -> Solution[StateType]:
        if not isinstance(method, LevenbergMarquardt):
            raise InputError(
                f"Unrolled got the method {type(method).__name__}, expected LevenbergMarquardt; "
                "Implicit differentiates what others solve"
            )
        if not torch.is_grad_enabled():
            return method.minimize(objective, initial, bounds)
        _require_residuals(objective, "Unrolled")
        with torch.no_grad():
            whole = record(objective, initial, method, bounds)
        solution = whole.solution
        layout = Layout.of(solution.state)
        good = _solved(solution, layout)
        if not whole.steps:
            return solution
        with finite_saved_numbers(good):
            state = replay(objective, whole.steps, bounds, good, self.steps)
        kind = torch.where(good, Sensitivity.UNROLLED, Sensitivity.ZERO)
        return replace(solution, state=state, sensitivity=kind.reshape(layout.batch))


def _require_residuals(objective: Objective, method: str) -> None:
    """The solver sees a bound on the curvature of some energies, which has no exact gradient."""
    inner = {name: getattr(energy, "energy", energy) for name, energy in objective.items()}
    unknown = [name for name, energy in inner.items() if isinstance(energy, Majorized)]
    if unknown:
        raise InputError(
            f"{method} gradients through the solve of {', '.join(unknown)}: such an energy is no "
            "sum of squares and the solver sees only a bound on its curvature, which would make "
            "gradients wrong without a word; use Implicit(), which has its own second derivatives"
        )


def _solved(solution: Solution[StateType], layout: Layout) -> Tensor:
    """Elements that have a minimum to speak of, (B,)."""
    if solution.status.shape != layout.batch:
        raise InputError(
            f"the method gives a status of shape {tuple(solution.status.shape)} for a batch "
            f"{tuple(layout.batch)}: it solves frames on their own, which has no Implicit "
            "gradient yet; use LevenbergMarquardt or Adam"
        )
    status = solution.status.reshape(-1)
    good = torch.ones_like(status, dtype=torch.bool)
    for failure in _FAILED:
        good = good & (status != failure)
    return good
