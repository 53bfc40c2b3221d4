"""Windows of different clips that are solved as one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.trajectory import Trajectory
from perfcap.geometry.camera import Camera
from perfcap.pipeline.adapt import fine
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.objective import pose_objective, trajectory_prior
from perfcap.pipeline.start_clip import StartedClip, targets_energy
from perfcap.solve import Objective
from perfcap.solve.energy import Energy
from perfcap.temporal.window import Window

WEIGHTS = ("joints2d", "joints3d", "targets", "trajectory", "prior")
"""Energies of a refinement, in the order of their learned weights."""


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
        pairs = zip(self.clips, self.windows, strict=True)
        return Motion.stack([clip.motion[window.index] for clip, window in pairs])

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
        prior = self._trajectory(config, rate)
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
            energies["targets"] = targets_energy(actor, self.stack(known), certain, config)
        if "joints3d" in energies:
            self._resize(energies["joints3d"])
        preference = weights.new_tensor([clip.preference for clip in self.clips])
        for name, energy in energies.items():
            factor = weights[WEIGHTS.index(name)]
            if name in ("trajectory", "prior"):
                factor = factor * preference
            energy.weight = energy.weight.to(factor) * factor
        return Objective(energies)

    def _trajectory(self, config: PoseConfig, rate: float) -> Trajectory:
        """The temporal prior, or what first solves made of it."""
        frames = len(self.windows[0])
        seconds = [clip.second for clip in self.clips]
        if any(each is None for each in seconds):
            return trajectory_prior(config.trajectory, frames, rate)
        pairs = zip(seconds, self.windows, strict=True)
        rows = [each.fitted.at(window.index) for each, window in pairs if each is not None]
        settled = fine(config.trajectory, config.evidence)
        return trajectory_prior(settled, frames, rate, torch.stack(rows))

    def _resize(self, energy: Energy[Motion]) -> None:
        """Give 3D joints the weight and the kernel of their clip's errors.

        A kernel of squared width w is that of width 1 of residuals divided by w, times w.
        """
        assert isinstance(energy, JointPosition)
        seconds = [clip.second for clip in self.clips]
        if any(each is None for each in seconds):
            return
        known = [each for each in seconds if each is not None]
        width = energy.confidence.new_tensor([each.width3d for each in known])
        gain = energy.weight.new_tensor([each.weight3d for each in known])
        energy.confidence = energy.confidence / width[:, None, None]
        energy.weight = energy.weight * gain * width

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
