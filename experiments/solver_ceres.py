"""Ceres on perfcap's window problem, with native bounds; needs the ``pyceres`` package.

``|(I - C'C) y|^2`` is the minimum over z of ``|y - C'z|^2``: with the DCT coefficients z as one
more block, every residual sees one frame and z, and DENSE_SCHUR eliminates the frames.
"""

from __future__ import annotations

import time

import numpy as np
import pyceres
import torch
from solver_peers import Rows, Trace, trajectory

_NEVER = 1e-14  # tolerances that do not end a run


def solve(
    rows: Rows, frames: list[Rows], lower: np.ndarray, upper: np.ndarray, iterations: int
) -> Trace:
    """Solve within bounds (F, D) on one thread.

    Args:
        rows: of the window.
        frames: of each frame alone.
        lower: bounds on the step from the initial motion.
        upper: the same.
        iterations: at most.

    Returns:
        The trace, without the CPU time of the Python code that evaluates residuals.
    """
    basis = trajectory(rows.objective).basis.numpy()
    features = rows(np.zeros(lower.shape))[2].numpy()
    blocks = list(np.clip(np.zeros(lower.shape), lower, upper))
    coefficients = (basis @ features).ravel().copy()
    costs = [Frame(frame, basis[:, f]) for f, frame in enumerate(frames)]
    problem = pyceres.Problem()
    for cost, block, low, high in zip(costs, blocks, lower, upper, strict=True):
        problem.add_residual_block(cost, None, [block, coefficients])
        for k in np.flatnonzero(np.isfinite(low)):
            problem.set_parameter_lower_bound(block, int(k), low[k])
            problem.set_parameter_upper_bound(block, int(k), high[k])
    watch = Watch(costs)
    pyceres.solve(_options(iterations, watch), problem, pyceres.SolverSummary())
    return watch.trace


def _options(iterations: int, watch: Watch) -> pyceres.SolverOptions:
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.DENSE_SCHUR
    options.logging_type = pyceres.LoggingType.SILENT
    options.max_num_iterations, options.num_threads = iterations, 1
    options.function_tolerance = options.parameter_tolerance = options.gradient_tolerance = _NEVER
    options.callbacks = [watch]
    return options


class Frame(pyceres.CostFunction):  # type: ignore[misc]
    """Residuals of one frame: data, and features minus what the coefficients say of them."""

    def __init__(self, rows: Rows, column: np.ndarray) -> None:
        super().__init__()
        data, slope, features, _ = rows(np.zeros(rows.initial.frame_dim))
        self.rows, self.lift = rows, np.kron(column, np.eye(features.shape[1]))
        self.seconds = 0.0
        self.set_num_residuals(data.numel() + features.numel())
        self.set_parameter_block_sizes([slope.shape[-1], self.lift.shape[1]])
        self.coefficient_slope = np.pad(-self.lift, ((data.numel(), 0), (0, 0))).ravel()

    def Evaluate(  # noqa: D102
        self, parameters: list[np.ndarray], residuals: np.ndarray, jacobians: list[np.ndarray]
    ) -> bool:
        start = time.process_time()
        data, slope, features, feature_slope = self.rows(np.array(parameters[0]))
        residuals[:] = np.concatenate((data[0], features[0].numpy() - self.lift @ parameters[1]))
        if jacobians is not None:
            if jacobians[0] is not None:
                jacobians[0][:] = torch.cat((slope[0], feature_slope[0])).numpy().ravel()
            if jacobians[1] is not None:
                jacobians[1][:] = self.coefficient_slope
        self.seconds += time.process_time() - start
        return True


class Watch(pyceres.IterationCallback):  # type: ignore[misc]
    """Keeps CPU time, without that of Python, and energy of every iteration."""

    def __init__(self, costs: list[Frame]) -> None:
        super().__init__()
        self.costs = costs
        self.start, self.trace = time.process_time(), list[tuple[float, float]]()

    def __call__(self, summary: pyceres.IterationSummary) -> pyceres.CallbackReturnType:
        """Record."""
        inside = time.process_time() - self.start - sum(cost.seconds for cost in self.costs)
        self.trace.append((inside, 2 * summary.cost))
        return pyceres.CallbackReturnType.SOLVER_CONTINUE
