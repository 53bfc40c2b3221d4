"""Minima to the last digit, which differences of solutions need."""

from __future__ import annotations

import torch

from perfcap.solve import Bounds, LevenbergMarquardt, Objective, State, solve
from perfcap.solve.assembly import assemble
from perfcap.solve.implicit_step import free_unknowns, invert
from perfcap.solve.layout import Layout
from perfcap.solve.stationarity import hessian


def minimum(objective: Objective, initial: State, bounds: Bounds | None = None) -> State:
    """Levenberg-Marquardt, then Newton steps on the free coordinates until the gradient is gone."""
    state = solve(objective, initial, LevenbergMarquardt(300, 1e-12), bounds).state
    layout = Layout.of(state)
    with torch.no_grad():
        for _ in range(4):
            equations = assemble(objective, state)
            gradient = equations.gradient()
            free = free_unknowns(state, bounds, gradient, layout)
            good = torch.ones_like(free[:, 0], dtype=torch.bool)
            inverse = invert(hessian(objective, state, equations), equations, free, good)
            state = state.retract(layout.unflatten(-inverse.solve(gradient)))
        left = (free * assemble(objective, state).gradient()).abs().max()
    scale = equations.curvature.abs().max()
    assert left <= 1e-12 * scale, f"gradient {float(left):.2g} left at the minimum"
    return state
