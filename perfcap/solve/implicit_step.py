"""A step of length zero whose derivative is that of the solution it starts from."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Protocol

import torch
from torch import Tensor

from perfcap.precision import own_precision
from perfcap.solve.bounds import Bounds, step_box
from perfcap.solve.damped_model import added_damping, damping_scale
from perfcap.solve.energy import State
from perfcap.solve.factorization import Factorization, factorize
from perfcap.solve.layout import Layout
from perfcap.solve.normal_equations import NormalEquations
from perfcap.solve.solution import Sensitivity


@dataclass(frozen=True)
class ReducedInverse:
    """The inverse of a Hessian on the coordinates that are free, zero elsewhere.

    Attributes:
        factorization: of the Hessian, with the identity on coordinates that are not free.
        free: 1 where a coordinate may move, else 0, (B, N); all 0 where there is no inverse.
        sensitivity: what the inverse is of, ``Sensitivity`` values (B,).
    """

    factorization: Factorization
    free: Tensor
    sensitivity: Tensor

    def solve(self, rows: Tensor) -> Tensor:
        """The inverse, which is symmetric, times rows (B, N)."""
        # rows that are not solved for must not bring in what is not finite
        seen = torch.where(self.free > 0, rows, 0)
        return self.free * self.factorization.solve(seen)


def free_unknowns(state: State, bounds: Bounds | None, gradient: Tensor, layout: Layout) -> Tensor:
    """1 where a coordinate may move, 0 where it presses against a bound, (B, N).

    A coordinate on its bound whose gradient is zero, or even leads inwards, may move: where an
    infinitesimal change of the data decides whether the bound acts, the derivative taken is the
    one of the side on which it does not.
    """
    box = step_box(bounds, state, layout)
    if box is None:
        return torch.ones_like(gradient)
    pressed = (box.at <= box.lower) & (gradient > 0)
    pressed |= (box.at >= box.upper) & (gradient < 0)
    pressed |= box.lower >= box.upper
    return (~pressed).to(gradient)


def invert(
    exact: NormalEquations | None,
    approximate: NormalEquations,
    free: Tensor,
    good: Tensor,
    damping: float = 0.0,
) -> ReducedInverse:
    """Invert the best matrix that is positive definite on the free coordinates.

    Args:
        exact: with the Hessian, tried first; None to start with the next.
        approximate: with the Gauss-Newton matrix; if that is singular a little damping is added,
            in proportion to the curvature of the data.
        free: coordinates that may move, (B, N).
        good: elements to be inverted at all, (B,).
        damping: always added, in the same proportion.
    """
    scale = free * added_damping(torch.ones_like(free[:, 0]), damping_scale(approximate))
    equations = restrict(approximate, free)
    least = torch.finfo(free.dtype).eps ** 0.5
    tries = [(equations, damping, Sensitivity.GAUSS_NEWTON)]
    tries += [(equations, damping + least * 10.0**k, Sensitivity.DAMPED) for k in (0, 2, 4)]
    if exact is not None:
        tries.insert(0, (restrict(exact, free), damping, Sensitivity.EXACT))
    matrix, amount = equations.zeros(), torch.zeros_like(scale)
    found = torch.full_like(good, Sensitivity.ZERO, dtype=torch.long)
    wanting = good
    for candidate, share, kind in tries:
        matrix = candidate.where(wanting, matrix)
        amount = torch.where(wanting.unsqueeze(-1), share * scale, amount)
        factorization = factorize(matrix, amount)
        valid = factorization.valid & wanting
        found = torch.where(valid, kind, found)
        wanting = wanting & ~valid
        if not bool(wanting.any()):
            break
    usable = (found != Sensitivity.ZERO).unsqueeze(-1)
    return ReducedInverse(factorization, free * usable, found)


def restrict(equations: NormalEquations, free: Tensor) -> NormalEquations:
    """Equations in the free coordinates (B, N) alone; the others get the identity."""
    frame, shared = equations.layout.split(free)
    windows = tuple(
        replace(window, jacobian=window.jacobian * frame.unsqueeze(-2))
        for window in equations.windows
    )
    return replace(
        equations,
        curvature=_restrict(equations.curvature, frame),
        border=equations.border * frame.unsqueeze(-1) * shared[:, None, None],
        shared_curvature=_restrict(equations.shared_curvature, shared),
        windows=windows,
    )


def _restrict(matrix: Tensor, free: Tensor) -> Tensor:
    both = free.unsqueeze(-1) * free.unsqueeze(-2)
    return torch.where(both > 0, matrix, 0) + torch.diag_embed(1 - free)


class Inverse(Protocol):
    """What the derivative of a solution needs of a Hessian."""

    @property
    def free(self) -> Tensor:
        """1 where a coordinate may move, else 0, (B, N)."""

    def solve(self, rows: Tensor) -> Tensor:
        """The inverse, which is symmetric, times rows (B, N)."""


def attach(rows: Tensor, inverse: Inverse) -> Tensor:
    """Zeros (B, N) with the derivative of ``- inverse @ rows``."""
    step: Tensor = _Attach.apply(rows, inverse)  # type: ignore[no-untyped-call]
    return step


class _Attach(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rows: Tensor, inverse: Inverse) -> Tensor:
        ctx.inverse = inverse
        # a saved tensor, so that a second backward pass fails as torch's own operations do
        ctx.save_for_backward(inverse.free)
        return torch.zeros_like(rows)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor, None]:
        (_,) = ctx.saved_tensors
        if torch.is_grad_enabled():  # once_differentiable refuses only if the slope has a graph
            raise RuntimeError(
                "create_graph=True was asked of a gradient through a solve, whose second "
                "derivatives perfcap does not have: the inverse Hessian in it counts as a "
                "constant; use create_graph=False, or finite differences of first derivatives"
            )
        with own_precision(slope.device.type):
            return -ctx.inverse.solve(slope), None


@contextmanager
def finite_saved_numbers(good: Tensor) -> Iterator[None]:
    """Record graphs in which elements that failed cannot turn a gradient of zero into NaN.

    Zero times a NaN that an operation saved for its backward pass is NaN, in every parameter that
    the elements of a batch share. Where an element is not ``good`` (B,), numbers that are not
    finite are saved as ones: nothing but zeros ever meets them.
    """
    if bool(good.all()):
        yield
        return
    with torch.autograd.graph.saved_tensors_hooks(_finite, lambda saved: saved):
        yield


def _finite(saved: Tensor) -> Tensor:
    if not saved.is_floating_point():
        return saved
    return saved.detach().nan_to_num(1.0, 1.0, 1.0)
