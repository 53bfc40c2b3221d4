"""Damped, bounded steps as compiled loops, for plain tensors on the CPU.

Says the same as ``damped_step.py`` in torch, which tests hold it equal to. Only the factor of the
capacitance matrix and the product before it are torch's: it keeps to its own number of threads.
There are no shared unknowns here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.solve._box_numba import solve_all
from perfcap.solve._frames_numba import factorize_each
from perfcap.solve._model_numba import Model, from_basis, newton_steps, plain, to_basis
from perfcap.solve._products_numba import dot
from perfcap.solve._step_room import Filter, Room
from perfcap.solve.box_step import PIVOTS, ROUNDS, feasible_descent
from perfcap.solve.damped_model import DampedModel, DampedStep, negligible_share
from perfcap.solve.factorization import identity_where
from perfcap.solve.normal_equations import NormalEquations

Floats = NDArray[np.floating[Any]]
Flags = NDArray[np.bool_]


class _Problem(NamedTuple):
    """A model at a state, and its bounds."""

    curvature: Floats  # (B, F, D, D)
    gradient: Floats  # (B, F, D)
    features: Floats  # (B, F, E)
    here: Floats  # (B, N)
    scale: Floats  # (B, N)
    at: Floats  # (B, N)
    lower: Floats  # (B, N), or none where nothing is bounded
    upper: Floats


class _Answer(NamedTuple):
    """What is found; see ``DampedStep``."""

    step: Floats  # (B, N)
    damping: Floats  # (B, N)
    multipliers: Floats  # (B, N)
    valid: Flags  # (B,)
    promised: Floats  # (B,)
    share: Floats  # (B,)
    negligible: Flags  # (B,)


def damped_step(model: DampedModel, room: Room) -> DampedStep:
    """See ``damped_step.damped_step``."""
    equations, box = model.equations, model.box
    jacobian, features = _stacked(equations)
    if features.shape[-1] != room.defect.shape[-1]:
        raise InputError(
            f"window energies have {features.shape[-1]} features and had {room.defect.shape[-1]} "
            "before; expected as many at every state"
        )
    nowhere = model.at[:, :0]
    problem = _Problem(
        plain(equations.curvature),
        plain(equations.frame_gradient),
        features,
        here=plain(model.here),
        scale=plain(model.scale),
        at=plain(model.at),
        lower=plain(nowhere if box is None else box.lower),
        upper=plain(nowhere if box is None else box.upper),
    )
    found = _no_step(model)
    answer = _Answer(*(getattr(found, name).numpy() for name in _Answer._fields))
    value = np.array(model.value, problem.scale.dtype)
    defect = room.defect.numpy()
    frames = room.cholesky, room.solved, defect
    _factorize(problem, jacobian, value, np.array(model.undamped), *frames, answer)
    root, positive = room.factorize_capacitance()
    found.valid.logical_and_(positive)
    if not all(model.running):
        found.valid.logical_and_(torch.tensor(model.running))
    parts = room.model(jacobian, identity_where(~positive, root))
    tiny = negligible_share(model.at.dtype)
    exact = np.ones(len(value), np.bool_)
    _solve(parts, room.filter, problem, ROUNDS, PIVOTS, tiny, answer, exact)
    if box is not None and not exact.all():
        descent = feasible_descent(equations, found.damping, box, found.step)
        found.step[:] = torch.where(torch.from_numpy(exact).unsqueeze(-1), found.step, descent)
        _judge(parts, room.filter, problem, tiny, answer)
    return found


def _stacked(equations: NormalEquations) -> tuple[Floats, Floats]:
    """Jacobians (B, F, E, D) and features (B, F, E) of all window energies."""
    if len(equations.windows) == 1:
        (window,) = equations.windows
        return plain(window.jacobian), plain(window.features)
    none = equations.curvature[..., :0, :]
    jacobians = [none, *(window.jacobian for window in equations.windows)]
    features = [none[..., 0], *(window.features for window in equations.windows)]
    return plain(torch.cat(jacobians, -2)), plain(torch.cat(features, -1))


def _no_step(model: DampedModel) -> DampedStep:
    """Room for an answer, with the multipliers of the model."""
    number = torch.zeros_like(model.at[:, 0])
    flag = torch.ones_like(number, dtype=torch.bool)
    return DampedStep(
        step=torch.empty_like(model.at),
        damping=torch.empty_like(model.at),
        multipliers=model.multipliers.clone(),
        valid=flag,
        promised=number,
        share=number.clone(),
        negligible=flag.clone(),
    )


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _factorize(
    problem: _Problem,
    jacobian: Floats,
    value: Floats,
    undamped: Flags,
    cholesky: Floats,
    solved: Floats,
    defect: Floats,
    answer: _Answer,
) -> None:
    """Damping, and the factors of all frames; whether they are positive definite."""
    frames, dim = problem.gradient.shape[1:]
    for b in range(len(value)):
        damping, here, scale = answer.damping[b], problem.here[b], problem.scale[b]
        share = value.dtype.type(0)
        valid = np.ones(frames, np.bool_)
        for n in range(len(damping)):
            unit = here[n] if undamped[b] and here[n] > 0 else scale[n]
            damping[n] = value[b] * unit if unit > 0 else value[b]
            if here[n] > 0:
                share = max(share, damping[n] / here[n])
            if not np.isfinite(damping[n]):
                valid[n // dim] = False
        answer.share[b] = share
        own = damping.reshape(frames, dim)
        parts = cholesky[b], solved[b], defect[b], valid
        factorize_each(problem.curvature[b], own, jacobian[b], *parts)
        answer.valid[b] = valid.all()


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _solve(
    model: Model,
    filters: Filter,
    problem: _Problem,
    rounds: int,
    pivots: int,
    tiny: float,
    answer: _Answer,
    exact: Flags,
) -> None:
    """Steps within the bounds, whether they are exact, and what they promise."""
    newton = np.empty_like(answer.step)
    newton_steps(model, problem.gradient, problem.features, filters.complement, newton)
    for b in range(len(newton)):
        answer.valid[b] = answer.valid[b] and np.isfinite(newton[b]).all()
        for n in range(newton.shape[1]):
            if not answer.valid[b]:
                newton[b, n] = 0
            answer.step[b, n] = newton[b, n]
    if problem.lower.shape[1] > 0:
        _hold_bounds(model, problem, rounds, pivots, newton, answer, exact)
    for b in range(len(newton)):
        answer.valid[b] = answer.valid[b] and np.isfinite(answer.step[b]).all()
        if not answer.valid[b]:
            answer.step[b] = 0
    _judge(model, filters, problem, tiny, answer)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _hold_bounds(
    model: Model,
    problem: _Problem,
    rounds: int,
    pivots: int,
    newton: Floats,
    answer: _Answer,
    exact: Flags,
) -> None:
    """See ``box_step``; steps come as ``newton``, multipliers as a guess."""
    lowest, highest = problem.lower - problem.at, problem.upper - problem.at
    held, unit = np.zeros_like(newton), np.empty_like(newton)
    tolerance = np.empty_like(newton[:, :1])
    for b in range(len(newton)):
        for n in range(newton.shape[1]):
            damping, guess = answer.damping[b, n], answer.multipliers[b, n]
            unit[b, n] = 1 / np.sqrt(damping) if damping > 0 else 1
            if answer.valid[b] and guess > 0 and problem.upper[b, n] < np.inf:
                held[b, n] = 1
            elif answer.valid[b] and guess < 0 and problem.lower[b, n] > -np.inf:
                held[b, n] = -1
            answer.multipliers[b, n] = 0
        sides = lowest[b], highest[b], problem.at[b], unit[b]
        tolerance[b, 0] = _tolerance(newton[b], *sides)
    bounds = lowest, highest, held, unit, tolerance
    solve_all(model, newton, *bounds, rounds, pivots, answer.step, answer.multipliers, exact)
    for b in range(len(newton)):
        for n in range(newton.shape[1]):
            # what a multiplier holds is on its bound but for rounding; put it there
            step, pull = answer.step[b, n], answer.multipliers[b, n]
            if pull != 0:
                step = highest[b, n] if pull > 0 else lowest[b, n]
            step = min(max(step, lowest[b, n]), highest[b, n])
            for _ in range(2):
                moved = problem.at[b, n] + step
                if moved > problem.upper[b, n] or moved < problem.lower[b, n]:
                    step = np.nextafter(step, newton.dtype.type(0))
            answer.step[b, n] = step


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _tolerance(newton: Floats, lowest: Floats, highest: Floats, at: Floats, unit: Floats) -> float:
    """Violations that are rounding, in the units of the unknowns; see ``box_step``."""
    eps = np.finfo(newton.dtype).eps
    worst, size = newton.dtype.type(0), newton.dtype.type(0)
    for n in range(len(newton)):
        worst = max(worst, max(newton[n] - highest[n], lowest[n] - newton[n]) / unit[n])
        if lowest[n] > -np.inf or highest[n] < np.inf:
            size = max(size, abs(at[n]) / unit[n])
    return float(eps ** (2 / 3) * worst + 8 * eps * size)


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _judge(model: Model, filters: Filter, problem: _Problem, tiny: float, answer: _Answer) -> None:
    """What the model promises of the steps, and whether they are rounding of the unknowns."""
    frames, dim = problem.gradient.shape[1:]
    for b in range(len(answer.step)):
        step = answer.step[b].reshape(frames, dim)
        moved, residual = np.zeros_like(problem.features[b]), problem.features[b].copy()
        change = step.dtype.type(0)
        for f in range(frames):
            for i in range(dim):
                curved = dot(problem.curvature[b, f, i], step[f])
                change += step[f, i] * (2 * problem.gradient[b, f, i] + curved)
            for e in range(moved.shape[1]):
                moved[f, e] = dot(model.jacobian[b, f, e], step[f])
        _apply_filter(model, filters, moved)
        _apply_filter(model, filters, residual)
        for f in range(frames):
            for e in range(moved.shape[1]):
                change += moved[f, e] * (2 * residual[f, e] + moved[f, e])
        answer.promised[b] = -change
        size, reach = step.dtype.type(0), step.dtype.type(0)
        for n in range(answer.step.shape[1]):
            size += problem.scale[b, n] * answer.step[b, n] ** 2
            reach += problem.scale[b, n] * problem.at[b, n] ** 2
        answer.negligible[b] = size <= tiny * reach


@numba.njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _apply_filter(model: Model, filters: Filter, features: Floats) -> None:
    """``(I - C' diag(keep) C) y`` in place, (F, E)."""
    kept = np.zeros(model.root.shape[1], features.dtype)
    m = model
    frames = m.cholesky, m.solved, m.jacobian, m.defect
    unscaled = Model(*frames, filters.bases, m.start, m.feature, m.size, m.root)
    to_basis(unscaled, features, kept)
    for t in range(len(filters.keep)):
        for r in range(model.start[t], model.start[t] + model.size[t]):
            kept[r] *= -filters.keep[t]
    from_basis(unscaled, kept, features)
