"""Poses to start from where places of joints in the world are known."""

from __future__ import annotations

from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.energy.prior import PosePrior
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.rotation import matrix_to_rotvec
from perfcap.pipeline.clip_problem import targets_energy
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.objective import angle_bounds, neutral_angles
from perfcap.solve import LevenbergMarquardt, Objective, solve

TRUNK = [LANDMARKS.index(n) for n in ("neck", "r_shoulder", "l_shoulder", "r_hip", "l_hip")]
FIT_POINTS = 3  # joints that fix a pose in space


def trunk_start(actor: Actor, points: Tensor, weights: Tensor) -> Motion:
    """Root from a rigid fit of the trunk; angles at the neutral pose.

    Args:
        actor: who it is.
        points: of the landmarks in the world, (F, 16, 3) m.
        weights: of them, (F, 16), 0 where they are not known.
    """
    skeleton = actor.skeleton
    rest = skeleton.rest_landmarks[TRUNK]
    target, share = points[:, TRUNK], weights[:, TRUNK]
    fit = procrustes(
        rest.expand_as(target), target.where(share[..., None] > 0, 0.0), share, scale=False
    )
    root = (fit.rotation @ skeleton.rest_positions[0]) + fit.translation
    angles = neutral_angles(actor).expand(len(points), -1)
    return Motion(root, matrix_to_rotvec(fit.rotation), angles)


def placed_start(actor: Actor, points: Tensor, certain: Tensor, config: PoseConfig) -> Motion:
    """Each frame's pose (F,) from places of its joints alone.

    Places lead limbs around where pixels, from the neutral pose, catch them in a wrong minimum.

    Args:
        actor: who it is.
        points: of the landmarks in the world, from K estimates, (F, K, 16, 3) m.
        certain: their confidence, (F, K, 16), 0 where they are not known.
        config: weights, units and steps.
    """
    total = certain.sum(1)
    middle = (certain[..., None] * points).sum(1) / total.clamp(min=1e-9)[..., None]
    start = trunk_start(actor, middle, total)
    energies = {
        "targets": targets_energy(actor, points[:, None], certain[:, None], config),
        "prior": PosePrior(neutral_angles(actor), config.prior.deviation, config.prior.weight),
    }
    initial = start.map(lambda each: each[:, None])
    method = LevenbergMarquardt(config.initial_steps, tolerance=config.initial_tolerance)
    objective = Objective(energies).to(actor.skeleton.lower)
    found: Motion = solve(objective, initial, method, angle_bounds(actor)).state
    return found.map(lambda each: each[:, 0])
