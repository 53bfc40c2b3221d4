"""Second derivatives of residuals: what a Gauss-Newton matrix leaves out.

They are needed where a solution is differentiated, and nowhere in finding it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

from perfcap.solve.energy import Energy, StateType, Step, WindowEnergy, seen_columns


@dataclass(frozen=True)
class SecondOrder:
    """Second derivative of ``<pull, residual>`` in the tangent of a state, by blocks.

    Attributes:
        frame: in the unknowns of each frame, (*b, F, D, D).
        border: in those and the shared ones that the energy sees, (*b, F, D, S'), None if none are.
        shared: in those shared ones, (*b, S', S'), None likewise.
    """

    frame: Tensor
    border: Tensor | None = None
    shared: Tensor | None = None


@runtime_checkable
class OffersSecondOrder(Protocol):
    """An energy with second derivatives in closed form."""

    def second_order(self, state: Any, pull: Tensor) -> SecondOrder | None:
        """Second derivative of ``<pull, residual>``; None where it is zero.

        The pull has the shape of the residual, (*b, F, G, d); of a ``WindowEnergy`` it is that of
        the features, (*b, F, E), which then stand in for the residual.
        """


def second_order(energy: Energy[StateType], state: StateType, pull: Tensor) -> SecondOrder | None:
    """Second derivative of ``<pull, residual>``, or for a window energy ``<pull, features>``."""
    if isinstance(energy, OffersSecondOrder):
        return energy.second_order(state, pull)
    if isinstance(energy, WindowEnergy):
        return SecondOrder(twice_differentiated(energy.features, state, pull).frame)
    found = twice_differentiated(lambda at: energy.residual(at).value, state, pull)
    seen = seen_columns(state.shared_sizes, energy.sees)
    if found.border is None or found.shared is None or not found.border[..., seen].shape[-1]:
        return SecondOrder(found.frame)
    shared = found.shared[..., seen]
    return SecondOrder(found.frame, found.border[..., seen], shared[..., seen, :])


@runtime_checkable
class OffersCurvature(Protocol):
    """Points with second derivatives in closed form."""

    def curvature(self, motion: Any, linearized: Any, pull: Tensor) -> SecondOrder:
        """Second derivative of ``<pull, points>`` for a pull (*b, F, N, d)."""


def points_second_order(points: Any, state: Any, linearized: Any, pull: Tensor) -> SecondOrder:
    """Second derivative of ``<pull, points>``, in the shared blocks that the points see.

    Args:
        points: N of them, of a state; see ``perfcap.actor.points``.
        state: where.
        linearized: ``points.linearize(state)``.
        pull: a constant, (*b, F, N, d).
    """
    if isinstance(points, OffersCurvature):
        return points.curvature(state, linearized, pull)
    whole = twice_differentiated(points, state, pull)
    if linearized[2] is None or whole.border is None or whole.shared is None:
        return SecondOrder(whole.frame)
    seen = seen_columns(state.shared_sizes, points.sees)
    return SecondOrder(whole.frame, whole.border[..., seen], whole.shared[..., seen][..., seen, :])


def twice_differentiated(
    function: Callable[[StateType], Tensor], state: StateType, pull: Tensor
) -> SecondOrder:
    """Second derivative of ``<pull, function(state)>`` by automatic differentiation.

    Rows of frame f see frame f only, so the derivative of the slopes in one unknown, summed over
    frames and batch elements, is a column of every block: D + S passes through one graph. Passes
    one by one need no more memory than one of them.

    Args:
        function: of the state, (*b, F, ...), each frame on its own.
        state: where.
        pull: a constant of the same shape.
    """
    here = state.coordinates()
    with torch.enable_grad():
        frame = torch.zeros_like(here.frame, requires_grad=True)
        shared = torch.zeros_like(here.shared, requires_grad=True)
        value = (pull.detach() * function(state.retract(Step(frame, shared)))).sum()
        both = frame, shared
        slopes = torch.autograd.grad(value, both, create_graph=True, materialize_grads=True)
        columns = [_columns(slope, both) for slope in slopes]
    by_frame, by_shared = columns[0][0], [part.mT for part in columns[1]]
    return SecondOrder(by_frame, by_shared[0], by_shared[1])


def _columns(slope: Tensor, unknowns: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """Derivative of each entry of slopes (*b, ..., n) in unknowns (*b, ..., m): (*b, ..., n, m)."""
    if not slope.requires_grad or not slope.shape[-1]:
        first, second = (u.new_zeros(*u.shape[:-1], slope.shape[-1], u.shape[-1]) for u in unknowns)
        return first, second
    rows = [
        torch.autograd.grad(
            entry.sum(), unknowns, retain_graph=True, allow_unused=True, materialize_grads=True
        )
        for entry in slope.unbind(-1)
    ]
    first, second = (torch.stack(part, -2) for part in zip(*rows, strict=True))
    return first, second
