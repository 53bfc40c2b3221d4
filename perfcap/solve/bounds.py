"""Box constraints on the coordinates of a state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.energy import State, StateType, Step
from perfcap.solve.layout import Layout


@dataclass(frozen=True)
class Bounds:
    """Closed box on ``state.coordinates()``; infinite where a coordinate is free.

    Args:
        lower: frame part (D,) or anything that broadcasts to (*b, F, D); shared part (S,) or
            broadcastable to (*b, S). Not above ``upper``; the two may be equal.
        upper: the same.
    """

    lower: Step
    upper: Step

    @classmethod
    def on_frames(cls, lower: Tensor, upper: Tensor) -> Bounds:
        """Bounds on the frame part alone; the shared part is free.

        Raises:
            InputError: they are integers, which have no infinity.
        """
        if not (lower.is_floating_point() and upper.is_floating_point()):
            raise InputError(
                f"bounds are {lower.dtype} and {upper.dtype}, expected floating-point numbers; "
                "take them there with .double()"
            )
        free = lower.new_tensor(torch.inf)
        return cls(Step(lower, -free), Step(upper, free))

    def rows(self, layout: Layout, like: Tensor) -> tuple[Tensor, Tensor]:
        """Lower and upper bounds as rows (B, N) in the precision of coordinates ``like``.

        Rounding to a lower precision goes inwards.

        Raises:
            InputError: bounds do not fit the state, hold a NaN, or cross.
        """
        try:
            lower, upper = layout.flatten(self.lower), layout.flatten(self.upper)
        except RuntimeError as error:
            frame, shared = tuple(self.lower.frame.shape), tuple(self.lower.shared.shape)
            raise InputError(
                f"bounds have frame shape {frame} and shared shape {shared}, expected them to "
                f"broadcast to D = {layout.frame_dim} unknowns a frame and S = "
                f"{layout.shared_dim} shared ones; build them like state.coordinates()"
            ) from error
        if not bool((lower <= upper).all()):
            raise InputError(
                "bounds: a lower bound is above its upper bound, or one is NaN; expected "
                "lower <= upper with infinities where a coordinate is free"
            )
        return _rounded(lower, like, torch.inf), _rounded(upper, like, -torch.inf)


def _rounded(bound: Tensor, like: Tensor, inwards: float) -> Tensor:
    """A bound in another precision, never further out."""
    rounded = bound.to(like)
    outside = (bound < rounded) if inwards < 0 else (bound > rounded)
    return torch.where(outside, torch.nextafter(rounded, rounded.new_tensor(inwards)), rounded)


@dataclass(frozen=True)
class StepBox:
    """The box as seen from a state: bounds on a step, rows (B, N) that always contain zero.

    Args:
        at: coordinates of the state, within the bounds.
        lower: bounds on the coordinates.
        upper: the same.
    """

    at: Tensor
    lower: Tensor
    upper: Tensor

    @cached_property
    def lowest(self) -> Tensor:
        """Least step."""
        return self.lower - self.at

    @cached_property
    def highest(self) -> Tensor:
        """Largest step."""
        return self.upper - self.at

    def at_state(self, state: State, layout: Layout) -> StepBox:
        """The same bounds, seen from another state."""
        return replace(self, at=layout.flatten(state.coordinates()))

    def clamp(self, step: Tensor) -> Tensor:
        """The nearest step in the box whose sum with the coordinates stays in it to the last bit.

        ``x + (upper - x)`` may round to the number above ``upper``; such a step is made a bit
        shorter.
        """
        step = step.clamp(self.lowest, self.highest)
        for _ in range(2):
            moved = self.at + step
            outside = (moved > self.upper) | (moved < self.lower)
            step = torch.where(outside, torch.nextafter(step, torch.zeros_like(step)), step)
        return step


def step_box(bounds: Bounds | None, state: State, layout: Layout) -> StepBox | None:
    """The box of steps at a state; None if nothing is bounded."""
    if bounds is None:
        return None
    at = layout.flatten(state.coordinates())
    return StepBox(at, *bounds.rows(layout, at))


def project(state: StateType, bounds: Bounds | None) -> StateType:
    """The state with its bounded coordinates moved into the box."""
    if bounds is None:
        return state
    layout = Layout.of(state)
    at = layout.flatten(state.coordinates())
    step = at.clamp(*bounds.rows(layout, at)) - at
    if not bool((step != 0).any()):
        return state
    return state.retract(layout.unflatten(step))
