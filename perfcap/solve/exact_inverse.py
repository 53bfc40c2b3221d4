"""The inverse of a Hessian that nobody writes down, by differences of exact gradients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from perfcap.solve.energy import Objective, State
from perfcap.solve.implicit_step import ReducedInverse
from perfcap.solve.layout import Layout

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
