"""Robust kernels inside compiled loops; see ``kernels.py``."""

from __future__ import annotations

import math

from perfcap.kernels import kernel
from perfcap.solve.kernels import GemanMcClure, Huber, Kernel, Quadratic

_QUADRATIC, _HUBER, _GEMAN_MCCLURE = 0, 1, 2
Robust = tuple[int, float]  # which kernel, and its scale


def as_numbers(kernel: Kernel) -> Robust | None:
    """A kernel for compiled loops; None for one that only torch knows."""
    if type(kernel) is Quadratic:
        return _QUADRATIC, 1.0
    if not isinstance(getattr(kernel, "scale", 1.0), float | int):
        return None  # a tensor may be learned, or be another one for every element
    if type(kernel) is Huber:
        return _HUBER, float(kernel.scale)
    if type(kernel) is GemanMcClure:
        return _GEMAN_MCCLURE, float(kernel.scale)
    return None


@kernel()
def robust(kernel: Robust, squared: float) -> tuple[float, float]:
    """Cost and slope of a squared residual."""
    kind, scale = kernel
    if kind == _HUBER:
        root = math.sqrt(max(squared, scale * scale))
        cost = squared if squared <= scale * scale else 2 * scale * root - scale * scale
        return cost, scale / root
    if kind == _GEMAN_MCCLURE:
        fall = 1 / (1 + squared / (scale * scale))
        return squared * fall, fall * fall
    return squared, 1.0
