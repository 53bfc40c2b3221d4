"""Energies that are no sum of squares, in a solver of sums of squares.

An energy of points that may be negative, and need not be convex, says at every state what it is
there, its slope in every point, and how much it may bend at most. The solver then sees a quadratic
that touches the energy, as a pull on every point; steps are accepted on the true energy. Where a
solution is differentiated, the energy's own second derivatives take that quadratic's place.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual, StateType
from perfcap.solve.energy_checks import fits, require_types
from perfcap.solve.products import apply_transposed
from perfcap.solve.second_order import SecondOrder, points_second_order

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
    up for it. Its kernel is quadratic. ``Implicit`` gradients need ``slope`` and
    ``second_derivative``, which differentiate ``values`` twice unless they are overridden.

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

    def slope(self, points: Tensor) -> Tensor:
        """Gradient in points (*b, F, N, d), differentiable in them and in what the energy holds."""
        with torch.enable_grad():
            at = points if points.requires_grad else points.detach().requires_grad_()
            (slope,) = torch.autograd.grad(self.values(at).sum(), at, create_graph=True)
        return slope

    def second_derivative(self, points: Tensor, moves: Tensor) -> Tensor:
        """Second derivative along K moves of the points, (*b, F, K, K).

        Args:
            points: (*b, F, N, d).
            moves: (*b, F, N, d, K).
        """
        with torch.enable_grad():
            at = points.detach().requires_grad_()
            slope = self.slope(at)
            # frames are on their own, so the slopes of all of them make one pass a move
            rows = [
                torch.autograd.grad((slope * move).sum(), at, retain_graph=True)[0]
                for move in moves.detach().unbind(-1)
            ]
        return torch.einsum("k...nd,...ndl->...kl", torch.stack(rows), moves)

    def forward(self, state: StateType) -> Tensor:
        """The true energy of each batch element, (*b,)."""
        return self.per_frame(state).sum(-1)

    def per_frame(self, state: StateType) -> Tensor:
        """The true energy of each frame, (*b, F)."""
        values = self.values(self.points(state)) + self.offset
        return self._weighed(values)

    def residual(self, state: StateType) -> Residual:
        """The pulls, (*b, F, N, d): zero where the model of the energy is least."""
        points = self.points(state)
        return Residual(_rows(self._expanded(points))[1])

    def linearize(self, state: StateType) -> Linearization:
        """The pulls, their derivatives, and the true energy."""
        points, frame, shared = self.points.linearize(state)
        expansion = self._expanded(points)
        root, pull = _rows(expansion)
        return Linearization(
            Residual(pull),
            root @ frame,
            None if shared is None else root @ shared,
            self._weighed(expansion.value + self.offset).sum(-1),
        )

    def gradient(self, state: StateType) -> tuple[Tensor, Tensor | None]:
        """Half the gradient of the true energy; see ``OffersGradient``."""
        points, frame, shared = self.points.linearize(state)
        slope = self._weighed_frames(0.5 * self.slope(points)).flatten(-2)
        of_frame = apply_transposed(frame.flatten(-3, -2), slope)
        if shared is None:
            return of_frame, None
        return of_frame, apply_transposed(shared.flatten(-3, -2), slope).sum(-2)

    def second_order(self, state: StateType, pull: Tensor) -> SecondOrder:
        """Half the true second derivative, less the rows that ``linearize`` has made of it.

        The pull, on those rows, says nothing of it.
        """
        linearized = points, frame, shared = self.points.linearize(state)
        slope = self._weighed_frames(0.5 * self.slope(points.detach()).detach())
        found = points_second_order(self.points, state, linearized, slope)
        moves = frame if shared is None else torch.cat((frame, shared), -1)
        bent = self._weighed_frames(0.5 * self.second_derivative(points, moves))
        root = _rows(self._expanded(points))[0]
        rows = (root @ moves).flatten(-3, -2)
        bent = bent - self._weighed_frames(rows.mT @ rows)
        own = state.frame_dim
        of_frame = found.frame + bent[..., :own, :own]
        if shared is None:
            return SecondOrder(of_frame)
        assert found.border is not None and found.shared is not None
        border = found.border + bent[..., :own, own:]
        return SecondOrder(of_frame, border, found.shared + bent[..., own:, own:].sum(-3))

    def _expanded(self, points: Tensor) -> Expansion:
        """``expand``, held to the shapes that it is asked for.

        Raises:
            InputError: they are others, which would be another energy where they broadcast.
        """
        found = self.expand(points)
        shapes = [tuple(x.shape) for x in (found.value, found.gradient, found.curvature)]
        frames, all_ = tuple(points.shape[:-2]), tuple(points.shape)
        if shapes[:2] != [frames, all_] or not fits(shapes[2], (*all_, all_[-1])):
            raise InputError(
                f"{type(self).__name__}.expand returned value, gradient and curvature {shapes} of "
                f"points {all_}; expected (*b, F), (*b, F, N, d) and (*b, F, N, d, d)"
            )
        require_types(self, "expand", points, found.gradient, found.curvature)
        return found

    def _weighed_frames(self, values: Tensor) -> Tensor:
        """The weight times values (*b, F, ., .)."""
        weight = self.weight.to(values)
        return (weight[..., None, None, None] if weight.ndim else weight) * values

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
    lower, failed = torch.linalg.cholesky_ex(half + ridge)
    # what is no number, or is negative, ends the element that holds it and no other
    lower = torch.where((failed == 0)[..., None, None], lower, torch.nan)
    pull = torch.linalg.solve_triangular(lower, 0.5 * expansion.gradient[..., None], upper=False)
    return lower.mT, pull.squeeze(-1)
