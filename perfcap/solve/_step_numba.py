"""Damped, bounded steps as compiled loops, for plain tensors on the CPU.

Says the same as ``damped_step.py`` in torch, which tests hold it equal to. Only the factor of the
capacitance matrix and the product before it are torch's: it keeps to its own number of threads.
There are no shared unknowns here. Python calls the kernels one after the other, since each is
compiled again with every kernel that calls it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.errors import InputError
from perfcap.kernels import inner, kernel
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


class _Bounds(NamedTuple):
    """Of steps; see ``box_step``."""

    lowest: Floats  # (B, N)
    highest: Floats
    held: Floats  # (B, N), sides to begin with
    unit: Floats  # (B, N)
    tolerance: Floats  # (B, 1)


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
    _factorize(model, problem, jacobian, room, answer)
    root, positive = room.factorize_capacitance()
    found.valid.logical_and_(positive)
    if not all(model.running):
        found.valid.logical_and_(torch.tensor(model.running))
    parts = room.model(jacobian, identity_where(~positive, root))
    tiny = negligible_share(model.at.dtype)
    newton = np.empty_like(answer.step)
    newton_steps(parts, problem.gradient, problem.features, room.filter.complement, newton)
    _take(newton, answer)
    if box is not None:
        bounds = _bounds(problem, newton, answer)
        exact = np.ones(len(newton), np.bool_)
        solve_all(parts, newton, *bounds, ROUNDS, PIVOTS, answer.step, answer.multipliers, exact)
        _keep_within(problem, bounds.lowest, bounds.highest, answer)
        if not exact.all():
            descent = feasible_descent(equations, found.damping, box, found.step)
            found.step[:] = torch.where(torch.from_numpy(exact).unsqueeze(-1), found.step, descent)
    _judge(parts, room.filter, problem, tiny, answer)
    return found


def _factorize(
    model: DampedModel, problem: _Problem, jacobian: Floats, room: Room, answer: _Answer
) -> None:
    """Damping, and the factors of all frames; whether they are positive definite."""
    value = np.array(model.value, problem.scale.dtype)
    valid = np.ones(problem.gradient.shape[:2], np.bool_)
    _damp(problem, value, np.array(model.undamped), answer, valid)
    damping = answer.damping.reshape(problem.gradient.shape)
    frames = problem.curvature, damping, jacobian, room.cholesky, room.solved, room.defect.numpy()
    factorize_each(*(x.reshape(valid.size, *x.shape[2:]) for x in frames), valid.reshape(-1))
    answer.valid[:] = valid.all(-1)


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


@kernel()
def _damp(problem: _Problem, value: Floats, undamped: Flags, answer: _Answer, valid: Flags) -> None:
    """Damping of all unknowns, and in which frames (B, F) it is finite."""
    dim = problem.gradient.shape[2]
    for b in range(len(value)):
        damping, here, scale = answer.damping[b], problem.here[b], problem.scale[b]
        share = value.dtype.type(0)
        for n in range(len(damping)):
            unit = here[n] if undamped[b] and here[n] > 0 else scale[n]
            damping[n] = value[b] * unit if unit > 0 else value[b]
            if here[n] > 0:
                share = max(share, damping[n] / here[n])
            if not np.isfinite(damping[n]):
                valid[b, n // dim] = False
        answer.share[b] = share


@kernel()
def _take(newton: Floats, answer: _Answer) -> None:
    """Newton's steps where they are finite; no step elsewhere."""
    for b in range(len(newton)):
        _drop_invalid(answer.valid, newton, b)
        for n in range(newton.shape[1]):
            answer.step[b, n] = newton[b, n]


@inner()
def _drop_invalid(valid: Flags, step: Floats, b: int) -> None:
    """No step where it is not finite, or known to be wrong."""
    for n in range(step.shape[1]):
        valid[b] = valid[b] and np.isfinite(step[b, n])
    if not valid[b]:
        for n in range(step.shape[1]):
            step[b, n] = 0


@kernel()
def _bounds(problem: _Problem, newton: Floats, answer: _Answer) -> _Bounds:
    """What ``box_step`` is given; multipliers come as a guess and go as zeros."""
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
    return _Bounds(lowest, highest, held, unit, tolerance)


@kernel()
def _keep_within(problem: _Problem, lowest: Floats, highest: Floats, answer: _Answer) -> None:
    """Steps end on the bounds that hold them, and none beyond any."""
    step = answer.step
    for b in range(len(step)):
        for n in range(step.shape[1]):
            # what a multiplier holds is on its bound but for rounding; put it there
            one, pull = step[b, n], answer.multipliers[b, n]
            if pull != 0:
                one = highest[b, n] if pull > 0 else lowest[b, n]
            one = min(max(one, lowest[b, n]), highest[b, n])
            for _ in range(2):
                moved = problem.at[b, n] + one
                if moved > problem.upper[b, n] or moved < problem.lower[b, n]:
                    one = np.nextafter(one, step.dtype.type(0))
            step[b, n] = one


@inner()
def _tolerance(newton: Floats, lowest: Floats, highest: Floats, at: Floats, unit: Floats) -> float:
    """Violations that are rounding, in the units of the unknowns; see ``box_step``."""
    eps = np.finfo(newton.dtype).eps
    worst, size = newton.dtype.type(0), newton.dtype.type(0)
    for n in range(len(newton)):
        worst = max(worst, max(newton[n] - highest[n], lowest[n] - newton[n]) / unit[n])
        if lowest[n] > -np.inf or highest[n] < np.inf:
            size = max(size, abs(at[n]) / unit[n])
    return float(eps ** (2 / 3) * worst + 8 * eps * size)


@kernel()
def _judge(model: Model, filters: Filter, problem: _Problem, tiny: float, answer: _Answer) -> None:
    """What the model promises of the steps, and whether they are rounding of the unknowns."""
    frames, dim = problem.gradient.shape[1:]
    for b in range(len(answer.step)):
        _drop_invalid(answer.valid, answer.step, b)
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


@inner()
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
