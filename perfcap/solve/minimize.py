"""The one entry to all minimisers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, overload

import torch
from torch import Tensor

from perfcap.eager import eager
from perfcap.errors import InputError
from perfcap.precision import own_precision
from perfcap.solve.adam import Adam
from perfcap.solve.adjoint import Adjoint, Detached
from perfcap.solve.bounds import Bounds, project
from perfcap.solve.dense import Function, Sides, pose
from perfcap.solve.energy import Energy, Objective, StateType, Step
from perfcap.solve.layout import Layout
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt
from perfcap.solve.solution import Method, Solution
from perfcap.solve.state_checks import require_box, require_kernels, require_sizes


@overload
def solve(
    objective: Objective,
    initial: StateType,
    method: Method | None = None,
    bounds: Bounds | None = None,
    adjoint: Adjoint | None = None,
) -> Solution[StateType]: ...


@overload
def solve(
    objective: Function,
    initial: Tensor,
    method: Method | None = None,
    bounds: Sides | None = None,
    adjoint: Adjoint | None = None,
) -> Solution[Any]: ...


@eager
def solve(
    objective: Objective | Function,
    initial: Any,
    method: Method | None = None,
    bounds: Any = None,
    adjoint: Adjoint | None = None,
) -> Solution[Any]:
    """Minimise an objective over a state, each batch element on its own.

    Args:
        objective: the energies; or a function that takes a tensor (*b, n) to residuals (*b, m),
            whose sum of squares is minimised.
        initial: where to start, (*b); moved into the bounds if it is outside. A tensor (*b, n)
            beside a function.
        method: settings of a minimiser, ``LevenbergMarquardt()`` by default.
        bounds: box on the coordinates of the state; every state visited stays in it. Beside a
            function a pair (lower, upper) of tensors, numbers or None.
        adjoint: whether and how the state of the solution carries gradients to what the energies
            hold: ``Detached()`` by default, ``Implicit()`` or ``Unrolled()``.

    Returns:
        The solution; its state is what ``initial`` was. The solve runs in the precision of the
        state, whatever autocast and ``torch.set_float32_matmul_precision`` say, and carries no
        gradient but for the one that ``adjoint`` attaches. An element that meets a value that is
        not finite keeps its last finite state and says so in its status; it never stops the others.

    Raises:
        InputError: something is of another kind than this says or holds no numbers, the state has
            no unknowns, or the bounds do not fit it.
    """
    _require_settings(method, adjoint)
    if isinstance(objective, Objective):
        _require_state(initial, bounds)
        return _solve(objective, initial, method, bounds, adjoint)
    if isinstance(objective, Energy) or not callable(objective):
        raise InputError(
            f"objective is a {type(objective).__name__}, expected an Objective of named energies, "
            "as in Objective(data=energy), or a function from a tensor (n,) to residuals (m,)"
        )
    posed, start, box = pose(objective, initial, bounds)
    solution: Solution[Any] = _solve(posed, start, method, box, adjoint)
    return replace(solution, state=solution.state.values)


def _solve(
    objective: Objective,
    initial: StateType,
    method: Method | None,
    bounds: Bounds | None,
    adjoint: Adjoint | None,
) -> Solution[StateType]:
    layout = Layout.of(initial)
    if layout.unknowns == 0 or layout.batch_size == 0:
        raise InputError(
            f"initial state has batch {tuple(layout.batch)} and {layout.unknowns} unknowns, "
            "expected at least one of each; nothing can be solved"
        )
    here = initial.coordinates()
    require_sizes(initial, here)
    _require_numbers(objective, here, bounds)
    _require_flat(initial, bounds, here.frame)
    if here.frame.dtype not in (torch.float32, torch.float64):
        raise InputError(
            f"initial state is {here.frame.dtype}, in which nothing can be solved; expected "
            "float32 or float64"
        )
    if here.frame.device.type == "cpu":
        _keep_freed_memory()
    require_box(initial, bounds)
    with torch.no_grad():
        start = project(initial, bounds)
        if here.frame.requires_grad or here.shared.requires_grad:
            start = start.retract(Step(torch.zeros_like(here.frame), torch.zeros_like(here.shared)))
    with own_precision(here.frame.device.type):
        way, settings = adjoint or Detached(), method or LevenbergMarquardt()
        if not isinstance(settings, Adam):  # which asks for no slope
            require_kernels(objective, start)
        return way.solve(objective, start, settings, bounds)


def _require_settings(method: object, adjoint: object) -> None:
    if method is not None and (isinstance(method, type) or not hasattr(method, "minimize")):
        raise InputError(
            f"method is {method!r:.80}, expected settings of a minimiser such as "
            "LevenbergMarquardt() or Adam()"
        )
    if adjoint is not None and not isinstance(adjoint, Adjoint):
        raise InputError(
            f"adjoint is {adjoint!r:.80}, expected Detached(), Implicit() or Unrolled()"
        )


def _require_state(initial: object, bounds: object) -> None:
    missing = [n for n in ("coordinates", "retract", "frame_dim") if not hasattr(initial, n)]
    if missing:
        raise InputError(
            f"initial is a {type(initial).__name__} without {', '.join(missing)}, expected a state "
            "such as Motion beside an Objective; a bare tensor goes with a function of it"
        )
    if bounds is not None and not isinstance(bounds, Bounds):
        raise InputError(
            f"bounds are a {type(bounds).__name__}, expected Bounds beside an Objective, as in "
            "Bounds.on_frames(lower, upper)"
        )


def _require_numbers(objective: Objective, here: Step, bounds: Bounds | None) -> None:
    """Refuse tensors that are shapes alone."""
    box = () if bounds is None else (bounds.lower, bounds.upper)
    named = {
        "initial state": (here.frame, here.shared),
        "bounds": tuple(each for side in box for each in (side.frame, side.shared)),
        "objective": (*objective.parameters(), *objective.buffers()),
    }
    for name, tensors in named.items():
        if any(each.is_meta for each in tensors):
            raise InputError(
                f"{name} has tensors on the meta device, which hold no numbers; expected cpu or "
                "cuda"
            )


def _require_flat(initial: object, bounds: Bounds | None, like: Tensor) -> None:
    """Refuse bounds on coordinates that a state says steps do not add to."""
    curved = getattr(initial, "curved", None)
    if bounds is None or curved is None or not like.is_cpu:
        return
    for side in (bounds.lower.frame, bounds.upper.frame):
        size = side.shape[-1] if side.ndim else 1
        own = side[..., curved] if size == like.shape[-1] else side
        if size in (1, like.shape[-1]) and bool(own.isfinite().any()):
            raise InputError(
                f"bounds hold coordinates {curved.start} to {curved.stop - 1} of a "
                f"{type(initial).__name__}, which are no numbers that steps add to (a rotation); "
                "leave them infinite"
            )


def _keep_freed_memory() -> None:
    """Have the C library keep freed blocks of up to 32 MB for the next allocation.

    The temporaries of a window are about a megabyte each. glibc hands such blocks back to the
    system when they are freed, and their page faults then cost as much as the arithmetic; once
    it has freed a block just below 32 MB it keeps smaller ones (mallopt(3), "dynamic mmap
    threshold"). The block is never touched, so it costs nothing itself.
    """
    torch.empty(31 << 20, dtype=torch.uint8)
