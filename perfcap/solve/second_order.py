"""Second derivatives of residuals: what a Gauss-Newton matrix leaves out.

They are needed where a solution is differentiated, and nowhere in finding it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

from perfcap.solve.energy import Energy, StateType, Step, WindowEnergy


@dataclass(frozen=True)
class SecondOrder:
    """Second derivative of ``<pull, residual>`` in the tangent of a state, by blocks.

    Attributes:
        frame: in the unknowns of each frame, (*b, F, D, D).
        border: in those and the shared ones, (*b, F, D, S), None if shared ones are not seen.
        shared: in the shared ones, (*b, S, S), None likewise.
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
        return forward_over_reverse(energy.features, state, pull)
    found = forward_over_reverse(lambda at: energy.residual(at).value, state, pull)
    return found if energy.sees_shared else SecondOrder(found.frame)


def forward_over_reverse(
    function: Callable[[StateType], Tensor], state: StateType, pull: Tensor
) -> SecondOrder:
    """Second derivative of ``<pull, function(state)>`` by automatic differentiation.

    Rows of frame f see frame f only, so one tangent shared by all frames and batch elements
    returns every block in D + S columns.

    Args:
        function: of the state, (*b, F, ...), each frame on its own.
        state: where.
        pull: a constant of the same shape.
    """
    here = state.coordinates()
    zero = here.frame.new_zeros(state.frame_dim + state.shared_dim)

    def slope(tangent: Tensor) -> tuple[Tensor, Tensor]:
        frame = tangent[: state.frame_dim].expand_as(here.frame)
        shared = tangent[state.frame_dim :].expand_as(here.shared)
        slopes: tuple[Tensor, Tensor] = torch.func.grad(value, argnums=(0, 1))(frame, shared)
        return slopes

    def value(frame: Tensor, shared: Tensor) -> Tensor:
        return (pull * function(state.retract(Step(frame, shared)))).sum()

    by_frame, by_shared = torch.func.jacfwd(slope)(zero)
    cut = state.frame_dim
    return SecondOrder(by_frame[..., :cut], by_frame[..., cut:], by_shared[..., cut:])
