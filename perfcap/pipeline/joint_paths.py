"""Paths of the joints as further unknowns of a window."""

from __future__ import annotations

from perfcap.actor.motion import Motion
from perfcap.energy.joint_trajectory import JointTrajectory
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.objective import kernel
from perfcap.solve import Objective


def with_paths(
    problem: ClipProblem, objective: Objective, start: Motion
) -> tuple[Objective, Motion]:
    """Windows with the paths that their settings ask for among the energies and the unknowns.

    Args:
        problem: of the windows.
        objective: of them.
        start: motion to start from, (N, W); its own paths are where theirs start.
    """
    config = problem.config.paths
    if config is None:
        return objective, start
    rank = min(config.rank, start.frames)
    robust = kernel(config.scale)
    energy = JointTrajectory(
        problem.actor.landmarks, start.frames, rank, config.weight, robust, config.deviation
    ).to(start.angles)
    return Objective(dict(objective.items()), paths=energy), energy.started(start)
