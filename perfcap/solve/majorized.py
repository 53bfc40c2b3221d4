"""Energies that are no sum of squares, in a solver of sums of squares.

An energy of points that may be negative, and need not be convex, says at every state what it is
there, its slope in every point, and how much it may bend at most. The solver then sees a quadratic
that touches the energy, as a pull on every point; steps are accepted on the true energy.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from perfcap.solve.energy import Coupling, Energy, Linearization, Residual, StateType

_RIDGE = 1e-9  # of a frame's largest curvature: for points that nothing is known of


@dataclass(frozen=True)
class Expansion:
    """An energy about points: ``value + <gradient, d> + <d, curvature d> / 2`` for a move d.

    Attributes:
        value: of each frame, (*b, F).
        gradient: in each point, (*b, F, N, d), mostly with d = 3.
        curvature: symmetric, not negative, (*b, F, N, d, d).
    """

    value: Tensor
    gradient: Tensor
    curvature: Tensor


class Majorized(Energy[StateType]):
    """An energy of points, given by its value, slope and a positive curvature.

    An author gives ``points`` (see ``perfcap.actor.points``) and writes ``values`` and ``expand``.
    The curvature need not be that of the energy; where it is too small the solver's damping makes
    up for it. Its kernel is quadratic.

    Args:
        points: N points of a state, with their derivatives.
        weight: of the energy.
        offset: what is added to every frame, so that the sum of all energies stays positive:
            minimisers stop by relative decreases.
    """

    coupling = Coupling.FRAME

    def __init__(self, points: Any, weight: float | Tensor = 1.0, offset: float = 0.0) -> None:
        super().__init__(weight)
        self.points, self.sees, self.offset = points, points.sees, float(offset)

    @abstractmethod
    def values(self, points: Tensor) -> Tensor:
        """The energy of each frame, (*b, F), of points (*b, F, N, d); differentiable."""

    @abstractmethod
    def expand(self, points: Tensor) -> Expansion:
        """The energy about points (*b, F, N, d)."""

    def forward(self, state: StateType) -> Tensor:
        """The true energy of each batch element, (*b,)."""
        return self.per_frame(state).sum(-1)

    def per_frame(self, state: StateType) -> Tensor:
        """The true energy of each frame, (*b, F)."""
        values = self.values(self.points(state)) + self.offset
        return self._weighed(values)

    def residual(self, state: StateType) -> Residual:
        """The pulls, (*b, F, N, d): zero where the model of the energy is least."""
        expansion = self.expand(self.points(state))
        return Residual(_rows(expansion)[1])

    def linearize(self, state: StateType) -> Linearization:
        """The pulls, their derivatives, and the true energy."""
        points, frame, shared = self.points.linearize(state)
        expansion = self.expand(points)
        root, pull = _rows(expansion)
        return Linearization(
            Residual(pull),
            root @ frame,
            None if shared is None else root @ shared,
            self._weighed(expansion.value + self.offset).sum(-1),
        )

    def _weighed(self, values: Tensor) -> Tensor:
        weight = self.weight.to(values)
        return (weight[..., None] if weight.ndim else weight) * values


def _rows(expansion: Expansion) -> tuple[Tensor, Tensor]:
    """Rows A (*b, F, N, d, d) and b (*b, F, N, d) with ``|A d + b|^2`` of the expansion's slope.

    ``A'A`` is half the curvature, and ``A'b`` half the gradient.
    """
    half = 0.5 * expansion.curvature
    trace = half.diagonal(dim1=-2, dim2=-1).sum(-1)
    largest = trace.amax(-1, keepdim=True).clamp(min=torch.finfo(half.dtype).tiny)
    ridge = (1e-3 * trace + _RIDGE * largest)[..., None, None] * torch.eye(half.shape[-1]).to(half)
    lower = torch.linalg.cholesky(half + ridge)
    pull = torch.linalg.solve_triangular(lower, 0.5 * expansion.gradient[..., None], upper=False)
    return lower.mT, pull.squeeze(-1)
