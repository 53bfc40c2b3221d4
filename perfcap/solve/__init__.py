"""Optimisation that has never heard of bodies."""

from perfcap.solve.adam import Adam
from perfcap.solve.adjoint import Adjoint, Detached, Implicit, Unrolled
from perfcap.solve.bounds import Bounds
from perfcap.solve.compound import Compound, of_part
from perfcap.solve.dense import ResidualFunction, Vector
from perfcap.solve.energy import (
    Coupling,
    Energy,
    Linearization,
    Objective,
    OffersBlocks,
    Residual,
    State,
    Step,
    WindowEnergy,
    forward_mode,
)
from perfcap.solve.kernels import GemanMcClure, Huber, Kernel, Quadratic
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt
from perfcap.solve.majorized import Expansion, Majorized
from perfcap.solve.minimize import solve
from perfcap.solve.newton import Newton
from perfcap.solve.solution import Method, Sensitivity, Solution, Status
from perfcap.solve.sparse import BlockLinearization
from perfcap.solve.truncated_newton import TruncatedNewton

__all__ = [
    "Adam",
    "Adjoint",
    "BlockLinearization",
    "Bounds",
    "Compound",
    "Coupling",
    "Detached",
    "Energy",
    "Expansion",
    "GemanMcClure",
    "Huber",
    "Implicit",
    "Kernel",
    "LevenbergMarquardt",
    "Linearization",
    "Majorized",
    "Method",
    "Newton",
    "Objective",
    "OffersBlocks",
    "Quadratic",
    "Residual",
    "ResidualFunction",
    "Sensitivity",
    "Solution",
    "State",
    "Status",
    "Step",
    "TruncatedNewton",
    "Unrolled",
    "Vector",
    "WindowEnergy",
    "forward_mode",
    "of_part",
    "solve",
]
