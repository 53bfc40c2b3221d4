"""Windows of different clips that are solved as one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.joint_target import JointTarget
from perfcap.energy.prior import PosePrior
from perfcap.geometry.camera import Camera
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.gaps import fill_gaps
from perfcap.pipeline.initialize import initialize, trunk_start
from perfcap.pipeline.jitter import relaxed
from perfcap.pipeline.objective import (
    angle_bounds,
    kernel,
    neutral_angles,
    person_height,
    pose_objective,
    trajectory_prior,
)
from perfcap.pipeline.pose_estimate import ClipEstimate
from perfcap.pipeline.prepare import prepare
from perfcap.solve import LevenbergMarquardt, Objective, solve
from perfcap.temporal.window import Window

WEIGHTS = ("joints2d", "joints3d", "targets", "trajectory", "prior")
"""Energies of a refinement, in the order of their learned weights."""

_FIT_POINTS = 3  # joints that fix a pose in space
_ROOT_DEVIATION = 0.05  # m, of where estimators put a whole person


@dataclass(frozen=True)
class StartedClip:
    """A clip and where its solve begins; none of it but the estimate carries a graph.

    Attributes:
        estimate: of the clip.
        motion: to start from, (F,).
        trusted3d: 3D poses that agree with the 2D joints, (F, C).
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
        preference: share of the weight of trajectory and prior that the clip's jitter asks for.
    """

    estimate: ClipEstimate
    motion: Motion
    trusted3d: Tensor
    pixel_unit: Tensor
    preference: float


@torch.no_grad()
def start_clip(actor: Actor, clip: ClipEstimate, config: PoseConfig) -> StartedClip:
    """Solve every frame of a clip on its own.

    Raises:
        InputError: nobody is detected in the whole clip.
    """
    unit = 0.01 * person_height(clip.detections)
    relaxing = replace(clip.detections, joints3d=clip.targets) if clip.targets is not None else None
    calm = relaxed(config, relaxing or clip.detections, unit)
    preference = calm.trajectory.weight / config.trajectory.weight
    if clip.has_pixels or clip.targets is None:
        prepared = prepare(actor, clip.cameras, clip.detections, config.position.gate)
        motion, _ = initialize(actor, clip.cameras, prepared, config, unit)
        return StartedClip(clip, motion, prepared.detections.trusted3d, unit, preference)
    motion = _placed_start(actor, clip, config)
    return StartedClip(clip, motion, clip.detections.trusted3d, unit, preference)


def _placed_start(actor: Actor, clip: ClipEstimate, config: PoseConfig) -> Motion:
    """Each frame's pose where only places of joints are known; frames without any are filled."""
    assert clip.targets is not None
    points, certain = clip.targets, clip.certain
    total = certain.sum(1)
    middle = (certain[..., None] * points).sum(1) / total.clamp(min=1e-9)[..., None]
    start = trunk_start(actor, middle, total)
    energies = {
        "targets": _targets(actor, points[:, None], certain[:, None], config),
        "prior": PosePrior(neutral_angles(actor), config.prior.deviation, config.prior.weight),
    }
    initial = Motion(start.translation[:, None], start.rotation[:, None], start.angles[:, None])
    method = LevenbergMarquardt(config.initial_steps, tolerance=config.initial_tolerance)
    objective = Objective(energies).to(actor.skeleton.lower)
    found: Motion = solve(objective, initial, method, angle_bounds(actor)).state
    motion = Motion(found.translation[:, 0], found.rotation[:, 0], found.angles[:, 0])
    return fill_gaps(motion, (total > 0).sum(-1) >= _FIT_POINTS)


def _targets(actor: Actor, points: Tensor, certain: Tensor, config: PoseConfig) -> JointTarget:
    own = points.new_tensor(config.position.deviation)
    unit = (own.square() + _ROOT_DEVIATION**2).sqrt()
    weight = config.position.weight
    return JointTarget(actor, points, certain, weight, kernel(config.position.scale), unit)


@dataclass(frozen=True)
class WindowBatch:
    """Windows of one length, each of a clip."""

    clips: tuple[StartedClip, ...]
    windows: tuple[Window, ...]

    def stack(self, values: Sequence[Tensor]) -> Tensor:
        """One tensor (F, ...) a clip, cut to the windows: (N, W, ...)."""
        pairs = zip(values, self.windows, strict=True)
        return torch.stack([value[window.index] for value, window in pairs])

    def start(self) -> Motion:
        """Motion to start from, (N, W)."""
        motions = [clip.motion for clip in self.clips]
        return Motion(
            self.stack([motion.translation for motion in motions]),
            self.stack([motion.rotation for motion in motions]),
            self.stack([motion.angles for motion in motions]),
        )

    def objective(
        self, actor: Actor, config: PoseConfig, rate: float, weights: Tensor
    ) -> Objective:
        """E_pose of the windows (Xu et al. 2018, Eq. 3), with a factor on the weight of each term.

        Args:
            actor: gives the joints.
            config: weights, units and kernels.
            rate: frames a second.
            weights: factors, in the order of ``WEIGHTS``.
        """
        prior = trajectory_prior(config.trajectory, len(self.windows[0]), rate)
        seen = self._detections()
        unit = torch.stack([clip.pixel_unit for clip in self.clips])[:, None]  # N 1 C
        objective = pose_objective(actor, self._cameras(), seen, config, unit, prior)
        energies = dict(objective.items())
        if not any(clip.estimate.has_pixels for clip in self.clips):
            del energies["joints2d"]
            energies.pop("joints3d", None)
        points = [clip.estimate.targets for clip in self.clips]
        known = [each for each in points if each is not None]
        if len(known) == len(points):
            certain = self.stack([clip.estimate.certain for clip in self.clips])
            energies["targets"] = _targets(actor, self.stack(known), certain, config)
        preference = weights.new_tensor([clip.preference for clip in self.clips])
        for name, energy in energies.items():
            factor = weights[WEIGHTS.index(name)]
            if name in ("trajectory", "prior"):
                factor = factor * preference
            energy.weight = energy.weight.to(factor) * factor
        return Objective(energies)

    def _detections(self) -> Detections:
        detections = [clip.estimate.detections for clip in self.clips]
        poses = [each.joints3d for each in detections if each.joints3d is not None]
        return Detections(
            self.stack([each.joints2d for each in detections]),
            self.stack([each.confidence2d for each in detections]),
            self.stack(poses) if len(poses) == len(detections) else None,
            self.stack([clip.trusted3d for clip in self.clips]),
        )

    def _cameras(self) -> Camera:
        """One set of cameras for all windows where they share it, else one a frame."""
        cameras = [clip.estimate.cameras for clip in self.clips]
        if all(each is cameras[0] for each in cameras) and not cameras[0].moving:
            return cameras[0]
        moving = [_every_frame(each, clip.estimate.frames) for each, clip in self._pairs(cameras)]
        lenses = [each.distortion for each in moving]
        if any(lens is not None for lens in lenses):
            none = moving[0].translation.new_zeros(())
            lenses = [
                none.expand(*each.translation.shape[:-1], 5) if lens is None else lens
                for each, lens in zip(moving, lenses, strict=True)
            ]
        return replace(
            cameras[0],
            intrinsics=self.stack([each.intrinsics for each in moving]),
            rotation=self.stack([each.rotation for each in moving]),
            translation=self.stack([each.translation for each in moving]),
            distortion=self.stack([x for x in lenses if x is not None])
            if lenses[0] is not None
            else None,
        )

    def _pairs(self, cameras: list[Camera]) -> list[tuple[Camera, StartedClip]]:
        return list(zip(cameras, self.clips, strict=True))


def _every_frame(cameras: Camera, frames: int) -> Camera:
    """Cameras (F, C), from fixed ones too."""
    if cameras.moving:
        return cameras
    lens = cameras.distortion
    return replace(
        cameras,
        intrinsics=cameras.intrinsics.expand(frames, -1, -1, -1),
        rotation=cameras.rotation.expand(frames, -1, -1, -1),
        translation=cameras.translation.expand(frames, -1, -1),
        distortion=None if lens is None else lens.expand(frames, -1, -1),
    )
