"""A stretch of a clip whose views are not quite known: poses, bone lengths and views as one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.motion import BONES, Motion
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.prior import BoneLengthPrior, PosePrior, SharedPrior
from perfcap.energy.uncertain_views import UncertainViews
from perfcap.pipeline.objective import FrameProblem, kernel, neutral_angles, trajectory_prior
from perfcap.solve import Bounds, Energy, LevenbergMarquardt, Objective, Step, solve
from perfcap.solve.covariance import shared_covariance

CORRELATION = 8.0  # frames over which the errors of detectors stay alike; they are no news


@dataclass(frozen=True)
class UncertainProblem:
    """What is solved to find clocks, places or lenses of views.

    Attributes:
        frames: F frames of fixed cameras; any actor will do, its bone lengths are unknown too.
        rate: frames a second.
        priors: deviations of Gaussians about zero, by the name of the block that they hold.
        steps: of the solver.
    """

    frames: FrameProblem
    rate: float
    priors: Mapping[str, Tensor] = field(default_factory=dict)
    steps: int = 30

    def solved(
        self, motion: Motion, views: Mapping[str, Tensor], ends: Mapping[str, tuple[Tensor, Tensor]]
    ) -> Motion:
        """The minimum from a motion (F,) and values of what is unknown of the views.

        Args:
            motion: of the actor.
            views: where each block starts.
            ends: lower and upper bounds of blocks that have any.
        """
        groups = len(self.frames.actor.skeleton.group_names)
        shared = {BONES: motion.angles.new_zeros(groups), **views}
        start = replace(motion, shared=shared)
        objective = self._objective(start, self.priors)
        method = LevenbergMarquardt(self.steps, self.frames.config.tolerance)
        state: Motion = solve(objective, start, method, self._bounds(start, ends)).state
        return state

    def deviations(
        self, state: Motion, fixed: Mapping[str, Tensor] | None = None
    ) -> dict[str, Tensor]:
        """Standard deviations of the shared blocks at a minimum.

        Args:
            state: the minimum.
            fixed: more Gaussians, of what is as good as known.
        """
        objective = self._objective(state, {**self.priors, **(fixed or {})})
        covariance = shared_covariance(objective, state)
        root = (CORRELATION * covariance.diagonal(dim1=-2, dim2=-1)).sqrt()
        sizes = state.shared_sizes
        return dict(zip(sizes, torch.split(root, list(sizes.values())), strict=True))

    def _objective(self, motion: Motion, priors: Mapping[str, Tensor]) -> Objective:
        known, frames = self.frames, motion.frames
        config, landmarks, seen = known.config, known.actor.landmarks, known.detections
        r, p = config.reprojection, config.position
        energies: dict[str, Energy[Any]] = {
            "joints2d": UncertainViews(
                landmarks,
                known.cameras,
                seen,
                r.weight,
                kernel(r.scale),
                r.deviation * known.pixel_unit,
            ),
            "trajectory": trajectory_prior(config.trajectory, frames, self.rate),
            "prior": PosePrior(neutral_angles(known.actor), config.prior.deviation),
            "bones": BoneLengthPrior(
                motion.shared_sizes[BONES], frames, config.bones.size, config.bones.own
            ),
        }
        if seen.joints3d is not None:
            energies["joints3d"] = JointPosition(
                landmarks,
                known.cameras,
                seen,
                p.weight_of(seen.views),
                kernel(p.scale),
                seen.joints3d.new_tensor(p.deviation),
            )
        for block, spread in priors.items():
            energies[f"{block} prior"] = SharedPrior(len(spread), frames, spread, block=block)
        return Objective(energies).to(motion.angles)

    def _bounds(self, motion: Motion, ends: Mapping[str, tuple[Tensor, Tensor]]) -> Bounds:
        """Angles within their limits, and blocks within theirs."""
        sides = []
        for side, sign in enumerate((-1.0, 1.0)):
            free = {n: torch.full_like(v, sign * torch.inf) for n, v in motion.shared.items()}
            free |= {name: ends[name][side] for name in ends if name in free}
            sides.append(torch.cat(list(free.values())))
        lower, upper = self.frames.actor.skeleton.bounds
        return Bounds(Step(lower, sides[0]), Step(upper, sides[1]))
