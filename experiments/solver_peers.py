"""A window as plain rows, for solvers that know nothing of its structure: dense ones, SciPy.

All see the same residuals and the same closed-form Jacobians. Their unknowns x (F, D) are a step
from the initial motion, with the root rotation as the rotation vector of that step.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from torch import Tensor
from window_problem import Problem

from perfcap.actor.motion import Motion
from perfcap.energy.trajectory import Trajectory
from perfcap.geometry.rotation import skew
from perfcap.solve import (
    Bounds,
    Coupling,
    Energy,
    LevenbergMarquardt,
    Linearization,
    Objective,
    Residual,
    Step,
    Vector,
    solve,
)

Trace = list[tuple[float, float]]  # CPU seconds and energy after each iteration


@dataclass(frozen=True)
class Rows:
    """Weighted residual rows of an objective of quadratic energies, frame by frame."""

    objective: Objective
    initial: Motion
    reference: Tensor  # features of the trajectory at the start, (F, E): give quaternions a sign

    @classmethod
    def of(cls, problem: Problem, frame: int | None = None) -> Self:
        """The rows of a window, or of one of its frames."""
        initial = problem.initial
        features = trajectory(problem.objective).features(initial)
        if frame is None:
            return cls(problem.objective, initial, features)
        at = slice(frame, frame + 1)
        return cls(problem.frame(frame), initial[at], features[at])

    def __call__(self, x: np.ndarray) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Data rows (F, R), their Jacobian (F, R, D); features (F, E), theirs (F, E, D)."""
        step = torch.from_numpy(x).reshape(len(self.reference), -1)
        state = self.initial.retract(Step(step, step.new_zeros(0)))
        chart = torch.eye(step.shape[-1]).to(step).repeat(len(step), 1, 1)
        chart[:, 3:6, 3:6] = _left_jacobian(step[:, 3:6])
        values, jacobians = [], []
        for energy in dict(self.objective.items()).values():
            if energy.coupling is Coupling.FRAME:
                linear = energy.linearize(state)
                root = energy.weight.sqrt().to(step)
                if linear.residual.confidence is not None:
                    root = root * linear.residual.confidence.sqrt()[..., None]
                values.append((root * linear.residual.value).flatten(1))
                jacobians.append((root[..., None] * linear.frame).flatten(1, 2))
        prior = trajectory(self.objective)
        features, slope = prior.linearize_features(state)
        agree = (features[:, 3:7] * self.reference[:, 3:7]).sum(-1)
        sign = torch.ones_like(features)
        sign[:, 3:7] = torch.where(agree < 0, -1.0, 1.0).to(step)[:, None]
        root = prior.weight.sqrt().to(step) * sign
        return (
            torch.cat(values, -1),
            torch.cat(jacobians, -2) @ chart,
            root * features,
            root[..., None] * slope @ chart,
        )

    def dense(self, x: np.ndarray) -> tuple[Tensor, Tensor]:
        """All residuals of the window (M,) and their Jacobian (M, F D)."""
        data, data_slope, features, slope = self(x)
        frames, dim = len(features), slope.shape[-1]
        blocks = torch.zeros(frames, data.shape[1], frames, dim).to(data)
        index = torch.arange(frames)
        blocks[index, :, index] = data_slope
        prior = trajectory(self.objective)
        keep = prior.basis.mT @ (prior.keep[:, None] * prior.basis)
        leave = torch.eye(frames).to(data) - keep.to(data)
        filtered = leave[:, None, :, None] * slope.transpose(0, 1)  # F E F D
        rows = torch.cat((blocks.flatten(0, 1), filtered.flatten(0, 1))).flatten(1)
        return torch.cat((data.flatten(), (leave @ features).flatten())), rows


class DenseRows(Energy[Vector]):
    """The whole window as one residual vector of a ``Vector``: no structure to exploit."""

    def __init__(self, rows: Rows) -> None:
        super().__init__()
        self.rows = rows

    def residual(self, state: Vector) -> Residual:  # noqa: D102
        return self.linearize(state).residual

    def linearize(self, state: Vector) -> Linearization:  # noqa: D102
        value, jacobian = self.rows.dense(state.values.numpy())
        return Linearization(Residual(value[None, None, :, None]), jacobian[None, None, :, None])


def dense_trace(problem: Problem, steps: int = 6) -> Trace:
    """The same Levenberg-Marquardt method on 1 650 unknowns of a single 'frame'."""
    rows = Rows.of(problem)
    lower, upper = (torch.from_numpy(bound.ravel()) for bound in step_bounds(problem))
    start = Vector(torch.zeros_like(lower)[None])
    trace: Trace = []
    for count in range(1, steps + 1):
        begin = time.process_time()
        method, bounds = LevenbergMarquardt(count), Bounds.on_frames(lower, upper)
        energy = solve(Objective(rows=DenseRows(rows)), start, method, bounds).energy
        trace.append((time.process_time() - begin, float(energy)))
    return trace


def scipy_trace(problem: Problem, evaluations: int = 25) -> Trace:
    """``scipy.optimize.least_squares``, trust region reflective."""
    from scipy.optimize import least_squares

    rows, (lower, upper) = Rows.of(problem), step_bounds(problem)
    trace: Trace = []
    start = time.process_time()

    def residual(x: np.ndarray) -> np.ndarray:
        value: np.ndarray = rows.dense(x)[0].numpy()
        trace.append((time.process_time() - start, float(value @ value)))
        return value

    def jacobian(x: np.ndarray) -> np.ndarray:
        matrix: np.ndarray = rows.dense(x)[1].numpy()
        return matrix

    room = lower.ravel() - 1e-9, upper.ravel() + 1e-9  # it starts strictly inside
    zero = np.zeros(lower.size)
    least_squares(residual, zero, jacobian, room, "trf", x_scale="jac", max_nfev=evaluations)
    return trace


def ceres_trace(problem: Problem, iterations: int = 60) -> Trace:
    """Ceres; see ``solver_ceres``.

    Raises:
        ImportError: pyceres is not installed.
    """
    import solver_ceres

    frames = [Rows.of(problem, f) for f in range(len(problem.initial.angles))]
    return solver_ceres.solve(Rows.of(problem), frames, *step_bounds(problem), iterations)


def step_bounds(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Bounds on a step from the initial motion, (F, D) each, that contain zero."""
    at = problem.initial.coordinates().frame
    lower, upper = problem.bounds.lower.frame - at, problem.bounds.upper.frame - at
    return lower.clamp(max=0).numpy(), upper.clamp(min=0).numpy()


def trajectory(objective: Objective) -> Trajectory:
    """The temporal prior of an objective."""
    energy = dict(objective.items())["trajectory"]
    assert isinstance(energy, Trajectory)
    return energy


def _left_jacobian(vector: Tensor) -> Tensor:
    """Derivative (..., 3, 3) of exp(v) as a left perturbation."""
    angle = vector.norm(dim=-1).clamp(min=1e-6)[..., None, None]
    cross = skew(vector)
    first, second = (1 - angle.cos()) / angle.square(), (angle - angle.sin()) / angle**3
    identity = torch.eye(3).to(vector)
    jacobian: Tensor = identity + first * cross + second * (cross @ cross)
    return jacobian
