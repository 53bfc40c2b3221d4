"""What recorded poses and smooth paths of the joints add to the windows of a clip."""

from __future__ import annotations

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.pose_statistics import Mixture
from perfcap.detect.detections import Detections
from perfcap.energy.joint_trajectory import JointTrajectory
from perfcap.io.pose_prior import load_pose_prior
from perfcap.pipeline.clip_problem import ClipProblem
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.objective import kernel
from perfcap.solve import Objective


def known_poses(actor: Actor, config: PoseConfig, detections: Detections) -> Mixture | None:
    """The shipped mixture of poses in the order of an actor's angles, where it is to count.

    Two views: from opposite sides they show depth by little else. One view has a lifter, which
    learned from the same recordings; more views need no such help.
    """
    if not config.prior.poses or detections.views != 2:
        return None
    return load_pose_prior().ordered(tuple(actor.skeleton.angle_names))


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
