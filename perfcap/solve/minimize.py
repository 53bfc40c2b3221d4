"""The one entry to all minimisers."""

from __future__ import annotations

import torch

from perfcap.errors import InputError
from perfcap.solve.adjoint import Adjoint, Detached
from perfcap.solve.bounds import Bounds, project
from perfcap.solve.energy import Objective, StateType, Step
from perfcap.solve.layout import Layout
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt
from perfcap.solve.method import Method
from perfcap.solve.solution import Solution


def solve(
    objective: Objective,
    initial: StateType,
    method: Method | None = None,
    bounds: Bounds | None = None,
    adjoint: Adjoint | None = None,
) -> Solution[StateType]:
    """Minimise an objective over a state, each batch element on its own.

    Args:
        objective: the energies.
        initial: where to start, (*b); moved into the bounds if it is outside.
        method: settings of a minimiser, ``LevenbergMarquardt()`` by default.
        bounds: box on the coordinates of the state; every state visited stays in it.
        adjoint: whether and how the state of the solution carries gradients to what the energies
            hold: ``Detached()`` by default, ``Implicit()`` or ``Unrolled()``.

    Returns:
        The solution. The solve runs in the precision of the state, whatever autocast says, and
        carries no gradient but for the one that ``adjoint`` attaches. An element that meets a
        value that is not finite keeps its last finite state and says so in its status; it never
        stops the others.

    Raises:
        InputError: the state has no unknowns, or the bounds do not fit it.
    """
    layout = Layout.of(initial)
    if layout.unknowns == 0 or layout.batch_size == 0:
        raise InputError(
            f"initial state has batch {tuple(layout.batch)} and {layout.unknowns} unknowns, "
            "expected at least one of each; nothing can be solved"
        )
    here = initial.coordinates()
    if here.frame.device.type == "cpu":
        _keep_freed_memory()
    with torch.no_grad():
        start = project(initial, bounds)
        if here.frame.requires_grad or here.shared.requires_grad:
            start = start.retract(Step(torch.zeros_like(here.frame), torch.zeros_like(here.shared)))
    with torch.autocast(here.frame.device.type, enabled=False):
        way = adjoint or Detached()
        return way.solve(objective, start, method or LevenbergMarquardt(), bounds)


def _keep_freed_memory() -> None:
    """Have the C library keep freed blocks of up to 32 MB for the next allocation.

    The temporaries of a window are about a megabyte each. glibc hands such blocks back to the
    system when they are freed, and their page faults then cost as much as the arithmetic; once
    it has freed a block just below 32 MB it keeps smaller ones (mallopt(3), "dynamic mmap
    threshold"). The block is never touched, so it costs nothing itself.
    """
    torch.empty(31 << 20, dtype=torch.uint8)
