"""Optimisation that has never heard of bodies."""

from perfcap.solve.adam import Adam
from perfcap.solve.bounds import Bounds
from perfcap.solve.dense import ResidualFunction, Vector
from perfcap.solve.energy import (
    Coupling,
    Energy,
    Linearization,
    Objective,
    Residual,
    State,
    Step,
    WindowEnergy,
    forward_mode,
)
from perfcap.solve.kernels import GemanMcClure, Huber, Kernel, Quadratic
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt
from perfcap.solve.minimize import Method, solve
from perfcap.solve.solution import Solution, Status
from perfcap.solve.sparse import BlockLinearization
from perfcap.solve.truncated_newton import TruncatedNewton

__all__ = [
    "Adam",
    "BlockLinearization",
    "Bounds",
    "Coupling",
    "Energy",
    "GemanMcClure",
    "Huber",
    "Kernel",
    "LevenbergMarquardt",
    "Linearization",
    "Method",
    "Objective",
    "Quadratic",
    "Residual",
    "ResidualFunction",
    "Solution",
    "State",
    "Status",
    "Step",
    "TruncatedNewton",
    "Vector",
    "WindowEnergy",
    "forward_mode",
    "solve",
]
