"""Whether a state's own methods, and an energy's own kernel, are what solvers take them for."""

from __future__ import annotations

import warnings
from typing import Any

import torch
from torch import Tensor

from perfcap.errors import InputError
from perfcap.solve.bounds import Bounds
from perfcap.solve.compound import OfPart
from perfcap.solve.energy import Objective, Residual, Step, WindowEnergy
from perfcap.solve.kernels import GemanMcClure, Huber, Kernel, Quadratic
from perfcap.solve.layout import Layout

_STEP = 1e-3  # of the coordinates' size, and of one
_OFF = 0.1  # share of a step
_ROUNDING = 16  # epsilons of a coordinate
_KNOWN = (Quadratic, Huber, GemanMcClure)
_SLOPE_OFF = 1e-2  # share of a slope
_MOST_OFF = 0.5  # share of residuals: a kernel may have corners


def require_sizes(state: Any, here: Step) -> None:
    """Refuse a state whose coordinates are of other numbers than it says.

    Raises:
        InputError: they are.
    """
    shared = sum(state.shared_sizes.values())
    found = tuple(here.frame.shape[-1:]), tuple(here.shared.shape[-1:])
    if found != ((state.frame_dim,), (shared,)):
        raise InputError(
            f"initial is a {type(state).__name__} of frame_dim {state.frame_dim} and shared_sizes "
            f"{dict(state.shared_sizes)} with coordinates {tuple(here.frame.shape)} and "
            f"{tuple(here.shared.shape)}; expected (*b, F, {state.frame_dim}) and (*b, {shared})"
        )


def require_box(state: Any, bounds: Bounds | None) -> None:
    """Refuse bounds on coordinates that steps do not add to: states would leave the box.

    A step or two of a state that is not this library's, whose own are tested, once a solve.

    Raises:
        InputError: a step changes a bounded coordinate otherwise than by itself, or the state.
    """
    if bounds is None or _is_ours(state) or _is_transformed():
        return
    layout = Layout.of(state)
    at = layout.flatten(state.coordinates()).detach().clone()
    lower, upper = bounds.rows(layout, at)
    boxed = (lower.isfinite() | upper.isfinite()) & at.isfinite()
    room = _ROUNDING * torch.finfo(at.dtype).eps * at.abs()
    wrong = boxed
    for sign in (1, -1):  # a state may clamp, and be at an end
        step = torch.where(boxed, sign * _STEP * (1 + at.abs()), 0)  # NaN is left where it is
        with torch.no_grad():
            moved = state.retract(layout.unflatten(step))
        if not hasattr(moved, "coordinates"):
            raise InputError(
                f"retract of {type(state).__name__} returned a {type(moved).__name__}; expected "
                "another state of its kind"
            )
        if not torch.allclose(layout.flatten(state.coordinates()), at, 0, 0, equal_nan=True):
            raise InputError(
                f"retract of {type(state).__name__} changes the state in place; return another "
                "one, as steps may be taken back"
            )
        gone = layout.flatten(moved.coordinates()) - at
        wrong = wrong & ~((gone - step).abs() <= _OFF * step.abs() + room)
        if not bool(wrong.any()):
            return
    raise InputError(
        f"bounds hold coordinates of a {type(state).__name__} that steps do not add to: a step of "
        f"{float(step[wrong][0]):.3g} moves one by {float(gone[wrong][0]):.3g}; expected "
        "retract(step).coordinates() to be their sum where bounds are finite"
    )


def require_kernels(objective: Objective, state: Any) -> None:
    """Refuse robust kernels of a user's own that solvers would take for converged, or misread.

    One value and slope at the residuals of the start, once a solve.

    Raises:
        InputError: a value or slope of another shape, a slope below zero, or one that is not the
            derivative of the value.
    """
    for name, energy in objective.items():
        kernel: object = getattr(energy, "kernel", None)
        if not isinstance(kernel, Kernel) or type(kernel) in _KNOWN or _is_transformed():
            continue
        whole = state
        while isinstance(energy, OfPart) and energy.name in whole.parts:
            energy, whole = energy.energy, whole.parts[energy.name]
        if isinstance(energy, WindowEnergy):
            continue
        with torch.no_grad():
            residual = energy.residual(whole)
        if isinstance(residual, Residual) and isinstance(residual.value, Tensor):
            _require_kernel(name, kernel, residual.squared_norm())


def _require_kernel(name: str, kernel: Kernel, squares: Tensor) -> None:
    kind = f"energy {name!r} has a {type(kernel).__name__}"
    with torch.enable_grad():
        asked = squares.clone().requires_grad_()
        value: object = kernel.value(asked.clone())
    slope: object = kernel.slope(squares.clone())
    for what, found in (("value", value), ("slope", slope)):
        if not isinstance(found, Tensor) or found.shape != squares.shape:
            own = tuple(found.shape) if isinstance(found, Tensor) else type(found).__name__
            raise InputError(
                f"{kind} whose {what} is {own} for squared residuals {tuple(squares.shape)}; "
                "expected as many numbers, one of each: torch.ones_like(squared) for a constant"
            )
    assert isinstance(value, Tensor) and isinstance(slope, Tensor)
    slope = slope.detach()
    if bool((slope < 0).any()):
        raise InputError(
            f"{kind} whose slope is {float(slope[slope < 0][0]):.3g}; expected numbers from 0 on, "
            "weights of rows: the cost may not fall as residuals grow"
        )
    moved = squares > 0
    if value.requires_grad and bool(moved.any()):
        true = torch.autograd.grad(value.sum(), asked)[0]
        wrong = (true - slope).abs() > _SLOPE_OFF * torch.maximum(true.abs(), slope)
        if float(wrong[moved].double().mean()) > _MOST_OFF:
            at = moved & wrong
            raise InputError(
                f"{kind} whose slope at a squared residual of {float(squares[at][0]):.3g} is "
                f"{float(slope[at][0]):.3g}, but its value grows by {float(true[at][0]):.3g} for "
                "one; expected the derivative of the value in the square, not in its root"
            )
    if bool(moved.any()) and not bool((slope[moved] != 0).any()):
        warnings.warn(
            f"{kind} whose slope is 0 at all residuals where they start, so that it has no effect; "
            "start nearer, or take a wider kernel first",
            stacklevel=2,
        )


def _is_ours(state: object) -> bool:
    return type(state).__module__.partition(".")[0] == "perfcap"


def _is_transformed() -> bool:
    return torch._C._functorch.maybe_current_level() is not None
