"""The exact minimiser of a quadratic model over a box, from an existing factorization.

    minimize  g.d + 1/2 d.H d   subject to  lowest <= d <= highest

Projecting the unconstrained step instead would break what H couples tightly: a nearly hard
smoothness prior ties the frames of one angle together. With multipliers m on the violated bounds
the step is ``d0 - H^-1 m``, and the multipliers solve a nonnegative program in the small matrix
``E' H^-1 E``. Its solution may leave or push other coordinates over their bounds; the worst of
them join, and the dual objective rises each time, so this ends at the exact solution.

Violations of unknowns in different units are compared in that of their damping, d^-1/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from perfcap.geometry.plain import is_plain
from perfcap.solve.bounds import StepBox
from perfcap.solve.factorization import Factorization
from perfcap.solve.layout import Layout
from perfcap.solve.nonnegative import NonnegativeProgram, pack
from perfcap.solve.normal_equations import NormalEquations

# --- Columns of the inverse matrix at some unknowns, kept as halves so that more can join ---------


@dataclass(frozen=True)
class InverseColumns:
    """``E' H^-1 E`` for unit vectors E, as a sum of squares: nothing cancels.

    Args:
        index: unknowns, (B, m).
        usable: which of them are meant; the others are padding, (B, m).
        frame: their frames, (B, m); anything for shared unknowns.
        own: ``L_f^-1 e`` in the frame's own factor, zero for shared unknowns, (B, m, D).
        common: the same in the factors of what couples frames, (B, m, rows).
    """

    index: Tensor
    usable: Tensor
    frame: Tensor
    own: Tensor
    common: Tensor

    @classmethod
    def at(cls, factorization: Factorization, index: Tensor, usable: Tensor) -> InverseColumns:
        """Columns at unknowns (B, m)."""
        layout = factorization.layout
        batch = torch.arange(len(index), device=index.device)[:, None]
        in_frame = (index < layout.frame_unknowns).unsqueeze(-1)  # B m 1
        place = index.clamp(max=layout.frame_unknowns - 1)
        frame = place.div(layout.frame_dim, rounding_mode="floor")
        inner = place - frame * layout.frame_dim
        own = factorization.frame_half(batch, frame, inner) * in_frame
        common = own[..., :0]
        if factorization.window is not None:
            window = factorization.window.half_rows(batch, frame, inner) * in_frame
            common = torch.cat((common, window), -1)
        if factorization.shared is not None:
            common = torch.cat((common, factorization.shared.half_rows(batch, index)), -1)
        return cls(index, usable, frame, own, common)

    def join(self, other: InverseColumns) -> InverseColumns:
        """These columns and others of the same factorization."""
        return InverseColumns(
            torch.cat((self.index, other.index), 1),
            torch.cat((self.usable, other.usable), 1),
            torch.cat((self.frame, other.frame), 1),
            torch.cat((self.own, other.own), 1),
            torch.cat((self.common, other.common), 1),
        )

    def block(self) -> Tensor:
        """``E' H^-1 E``, (B, m, m)."""
        together = self.frame.unsqueeze(-1) == self.frame.unsqueeze(-2)
        return (self.own @ self.own.mT) * together + self.common @ self.common.mT


# --- The exact minimiser of a quadratic model over a box, from an existing factorization ----------

ROUNDS = 60  # of joining bounds; one to eight are usual
PIVOTS = 300  # of the nonnegative program; one to five are usual


def box_step(
    equations: NormalEquations,
    factorization: Factorization,
    damping: Tensor,
    newton: Tensor,
    box: StepBox,
    warm: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Minimise the damped model over the box.

    Args:
        equations: the model.
        factorization: of ``equations`` with ``damping``.
        damping: what was added to the diagonal, (B, N).
        newton: the unconstrained minimiser, (B, N). Elements where it is zero are left alone.
        box: bounds on the step.
        warm: multipliers of a similar problem, (B, N); only their signs are used.

    Returns:
        The step, and the multipliers of the bounds that hold it (positive: upper), both (B, N).
    """
    none = torch.zeros_like(newton)
    held = none if warm is None else _bounded_sides(warm, box)
    unit = torch.where(damping > 0, damping, 1).rsqrt()
    step, multipliers, solved = _hold_bounds(factorization, newton, box, held, unit)
    # what a multiplier holds is on its bound but for rounding; put it there
    step = torch.where(multipliers > 0, box.highest, step)
    step = box.clamp(torch.where(multipliers < 0, box.lowest, step))
    if not bool(solved.all()):
        descent = feasible_descent(equations, damping, box, step)
        step = torch.where(solved.unsqueeze(-1), step, descent)
    return step, multipliers


def _hold_bounds(
    factorization: Factorization, newton: Tensor, box: StepBox, held: Tensor, unit: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Step and multipliers (B, N), from bounds held at first, and whether they are exact (B,)."""
    tolerance, layout = _tolerance(newton, box, unit), factorization.layout
    if is_plain(newton, box.lowest, box.highest) and factorization.shared is None:
        from perfcap.solve import _box_numba

        limits = ROUNDS, PIVOTS
        return _box_numba.box_steps(factorization, newton, box, held, unit, tolerance, limits)
    step, multipliers, columns = newton, torch.zeros_like(newton), None
    joining = fresh = held != 0
    solved = torch.ones_like(joining[:, 0])
    holding = bool(joining.any())
    for _ in range(ROUNDS):
        if holding:
            columns = _with_columns(columns, factorization, fresh)
            support = joining | (multipliers != 0)
            multipliers, solved = _multipliers(columns, newton, box, held, unit, support, tolerance)
            step = newton - factorization.solve(multipliers)
        side = _side(step, box)
        joining = _peaks(_violation(step, box), tolerance * unit, layout) & (side != held)
        holding = bool(joining.any())
        if not holding:
            break
        fresh = joining & (held == 0)
        held = torch.where(joining, side, held)
    return step, multipliers, solved & ~joining.any(-1)


def _bounded_sides(multipliers: Tensor, box: StepBox) -> Tensor:
    """Signs of multipliers (B, N), zero where their side has no bound."""
    bound = torch.where(multipliers > 0, box.upper, box.lower)
    return torch.where(bound.isfinite(), multipliers.sign(), 0)


def _violation(step: Tensor, box: StepBox) -> Tensor:
    """How far a step is outside; negative inside, (B, N)."""
    return torch.maximum(step - box.highest, box.lowest - step)


def _side(step: Tensor, box: StepBox) -> Tensor:
    """1 where the upper bound is the nearer violation, -1 where the lower one is, (B, N)."""
    upper = step - box.highest > box.lowest - step
    side: Tensor = 2 * upper.to(step.dtype) - 1
    return side


def _peaks(violation: Tensor, tolerance: Tensor, layout: Layout) -> Tensor:
    """Violated bounds that are the worst among their neighbours in time, (B, N).

    Frames of one angle move together: holding the worst one releases most of the others.
    """
    frame, _ = layout.split(violation)
    padded = torch.nn.functional.pad(frame, (0, 0, 1, 1), value=-torch.inf)
    peak = (frame >= padded[:, :-2]) & (frame >= padded[:, 2:])
    shared = torch.ones_like(violation[:, layout.frame_unknowns :], dtype=torch.bool)
    return torch.cat((peak.flatten(1), shared), -1) & (violation > tolerance)


def _tolerance(newton: Tensor, box: StepBox, unit: Tensor) -> Tensor:
    """Violations that are rounding, in units (B, N) of the unknowns: (B, 1).

    Relative to the largest one, and to the bounded coordinates.
    """
    precision = torch.finfo(newton.dtype).eps
    bounded = (box.lower > -torch.inf) | (box.upper < torch.inf)
    size = (torch.where(bounded, box.at.abs(), 0) / unit).amax(-1, keepdim=True)
    violation = _violation(newton, box) / unit
    worst = violation.nan_to_num(0).amax(-1, keepdim=True).clamp(min=0)
    return math.pow(precision, 2 / 3) * worst + 8 * precision * size


def _with_columns(
    columns: InverseColumns | None, factorization: Factorization, fresh: Tensor
) -> InverseColumns:
    """Columns of the inverse, and those at ``fresh`` unknowns (B, N) with them."""
    if columns is not None and not bool(fresh.any()):
        return columns
    joining = InverseColumns.at(factorization, *pack(fresh))
    return joining if columns is None else columns.join(joining)


def _multipliers(
    columns: InverseColumns,
    newton: Tensor,
    box: StepBox,
    held: Tensor,
    unit: Tensor,
    support: Tensor,
    tolerance: Tensor,
) -> tuple[Tensor, Tensor]:
    """Multipliers (B, N) that keep the ``held`` bounds, and whether they are exact (B,)."""
    index, usable = columns.index, columns.usable
    side = held.gather(1, index) / unit.gather(1, index)
    bound = torch.where(side > 0, box.highest.gather(1, index), box.lowest.gather(1, index))
    excess = torch.where(usable, side * (newton.gather(1, index) - bound), 0)
    matrix = columns.block() * (side.unsqueeze(-1) * side.unsqueeze(-2))
    program = NonnegativeProgram(matrix, excess, usable, tolerance)
    values, solved = program.solve(support.gather(1, index), PIVOTS)
    values = torch.where(usable, side * values, 0)
    return torch.zeros_like(newton).scatter_add(1, index, values), solved


def feasible_descent(
    equations: NormalEquations, damping: Tensor, box: StepBox, step: Tensor
) -> Tensor:
    """A step in the box that lowers the model, for elements whose program did not end.

    The clamped step if it does; otherwise the best point on the way to the projected, diagonally
    scaled gradient step, whose slope is never positive.
    """
    promised = equations.decrease(step) - (damping * step.square()).sum(-1)
    gradient = equations.gradient()
    scale = damping + equations.join(*equations.data_diagonal())
    fallback = box.clamp(-gradient / scale.clamp(min=torch.finfo(step.dtype).tiny))
    slope = -(gradient * fallback).sum(-1)
    curved = equations.apply(fallback) + damping * fallback
    length = slope / (fallback * curved).sum(-1)
    fallback = length.nan_to_num(0).clamp(0, 1).unsqueeze(-1) * fallback
    return torch.where((promised > 0).unsqueeze(-1), step, fallback)
