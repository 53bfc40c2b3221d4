"""The rig alone: how near a skeleton comes to known landmarks, without images or priors."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.joint_set import LANDMARKS
from perfcap.energy.prior import PosePrior
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.rotation import matrix_to_rotvec
from perfcap.pipeline.objective import angle_bounds, neutral_angles
from perfcap.solve import LevenbergMarquardt, Objective, solve
from perfcap.solve.energy import Coupling, Energy, Linearization, Residual

_TRUNK = [LANDMARKS.index(n) for n in ("neck", "r_shoulder", "l_shoulder", "r_hip", "l_hip")]
_UNIT = 0.001  # m: one residual
_PRIOR = 1e-6  # keeps twists that landmarks do not see


class LandmarkDistance(Energy[Motion]):
    """Squared distance of the landmarks to given places in the world, in millimetres."""

    coupling = Coupling.FRAME
    target: Tensor

    def __init__(self, actor: Actor, target: Tensor) -> None:
        super().__init__(1.0)
        self.actor = actor
        self.register_buffer("target", target)

    def residual(self, motion: Motion) -> Residual:
        """(*b, F, 16, 3)."""
        return Residual((self.actor.joints(motion) - self.target) / _UNIT)

    def linearize(self, motion: Motion) -> Linearization:
        """Closed form."""
        joints, frame, _ = self.actor.skeleton.linearize(motion)
        return Linearization(Residual((joints - self.target) / _UNIT), frame / _UNIT)


def fit_rig(actor: Actor, truth: Tensor, max_steps: int = 100) -> Motion:
    """The motion within the limits whose landmarks are nearest to ``truth`` (F, 16, 3), metres."""
    skeleton = actor.skeleton
    rest = skeleton.rest_landmarks[_TRUNK]
    fit = procrustes(rest.expand(len(truth), -1, -1), truth[:, _TRUNK], scale=False)
    root = fit.rotation @ skeleton.rest_positions[0] + fit.translation
    mean = neutral_angles(actor)
    start = Motion(root, matrix_to_rotvec(fit.rotation), mean.expand(len(truth), -1))
    single = Motion(start.translation[:, None], start.rotation[:, None], start.angles[:, None])
    objective = Objective(
        places=LandmarkDistance(actor, truth[:, None]), prior=PosePrior(mean, 1.0, _PRIOR)
    )
    method = LevenbergMarquardt(max_steps=max_steps)
    state: Motion = solve(objective, single, method, angle_bounds(actor)).state
    with torch.no_grad():
        return replace(
            start,
            translation=state.translation[:, 0],
            rotation=state.rotation[:, 0],
            angles=state.angles[:, 0],
        )
