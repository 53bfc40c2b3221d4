"""The pose objective: which energies, in which units, for frames or a stretch of a clip."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import usual_ranges
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_checks import require_pixels
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.prior import PosePrior
from perfcap.energy.reprojection import Reprojection
from perfcap.energy.trajectory import Trajectory
from perfcap.geometry.camera import Camera
from perfcap.geometry.plain import is_readable
from perfcap.pipeline.config import PoseConfig, TrajectoryConfig
from perfcap.rates import frame_rate
from perfcap.setting_checks import require_count
from perfcap.solve.bounds import Bounds
from perfcap.solve.energy import Energy, Objective
from perfcap.solve.kernels import GemanMcClure, Kernel, Quadratic

_REFERENCE_FRAMES, _REFERENCE_RATE = 50, 30.0  # what a rank is stated for
_STRAIGHT = 2  # DCT vectors that motion in one direction needs: the shortest clip may have it


@dataclass(frozen=True)
class FrameProblem:
    """What the poses of frames are found from, each frame on its own.

    Attributes:
        actor: gives the joints and the limits.
        cameras: C views, fixed or moving.
        detections: (F, C, 16).
        config: weights, units and kernels.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
    """

    actor: Actor
    cameras: Camera
    detections: Detections
    config: PoseConfig
    pixel_unit: Tensor

    @classmethod
    def of(
        cls, actor: Actor, cameras: Camera, detections: Detections, config: PoseConfig | None = None
    ) -> Self:
        """With the unit of pixels that the detections show.

        Raises:
            InputError: numbers of the actor's joints were changed.
        """
        actor.skeleton.tree.require_own()
        unit = 0.01 * detections.person_height()
        return cls(actor, cameras, detections, config or PoseConfig(), unit)

    def frames(self, index: slice | Tensor) -> Self:
        """The same for some frames, in the same units."""
        cameras, detections = self.cameras.frames(index), self.detections.frames(index)
        return replace(self, cameras=cameras, detections=detections)

    def view(self, view: int) -> Self:
        """The same for one view."""
        cameras, detections = self.cameras.select([view]), self.detections.select([view])
        unit = self.pixel_unit[[view]]
        return replace(self, cameras=cameras, detections=detections, pixel_unit=unit)

    def objective(self) -> Objective:
        """Joints in images and in space and the pose prior, of motions (F,)."""
        return pose_objective(
            self.actor, self.cameras, self.detections, self.config, self.pixel_unit
        )


def pose_objective(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    config: PoseConfig,
    pixel_unit: Tensor,
    trajectory: Trajectory | None = None,
) -> Objective:
    """E_2d + w_3d E_3d + w_d E_d (Xu et al. 2018, Eq. 3) and a weak pose prior.

    Args:
        actor: gives the joints.
        cameras: C views.
        detections: (*b, F, C), retargeted to the actor.
        config: weights, units and kernels.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
        trajectory: the temporal prior; frames are independent without.

    Raises:
        InputError: cameras that are none, or joints that are no pixels.
    """
    if is_readable(detections.joints2d) and is_readable(detections.confidence2d):
        require_pixels(detections)
    r, p, joints = config.reprojection, config.position, actor.landmarks
    energies: dict[str, Energy[Motion]] = {
        "joints2d": Reprojection(
            joints, cameras, detections, r.weight, kernel(r.scale), r.deviation * pixel_unit
        )
    }
    if detections.joints3d is not None and bool(detections.trusted3d.any()):
        unit = detections.joints3d.new_tensor(p.deviation)
        energies["joints3d"] = JointPosition(
            joints, cameras, detections, p.weight_of(detections.views), kernel(p.scale), unit
        )
    if trajectory is not None:
        energies["trajectory"] = trajectory
    mean = neutral_angles(actor)
    alone = detections.views == 1 and detections.joints3d is None
    deviation = config.prior.alone if alone else config.prior.deviation
    usual = usual_ranges(actor.skeleton.rig) if detections.views == 1 else None
    energies["prior"] = PosePrior(mean, deviation, config.prior.weight, usual, config.prior.beyond)
    return Objective(energies).to(actor.skeleton.lower)


def trajectory_prior(
    config: TrajectoryConfig, frames: int, rate: float, stiffness: Tensor | None = None
) -> Trajectory:
    """The temporal prior of a window of ``frames`` at ``rate`` frames a second.

    A rank is a frequency: K of 50 frames at 30 Hz end at 0.3 K Hz. Shorter windows and other
    frame rates keep that frequency, except for the paper's sharp edge, which keeps K.

    Args:
        config: weights, rank and edge.
        frames: of a window.
        rate: frames a second.
        stiffness: factors on the weights of translation, rotation and each angle, (N, 2 + A).

    Raises:
        InputError: frames or a rate that are none.
    """
    require_count(frames, "frames")
    keep = soft_edge(config, frames, frame_rate(rate))
    factor = keep.new_ones(3) if stiffness is None else stiffness.sqrt().unsqueeze(-2)
    return Trajectory(
        frames,
        weight=config.weight,
        translation=config.translation * factor[..., :1],
        rotation=config.rotation * factor[..., 1:2],
        angles=config.angles * factor[..., 2:],
        keep=keep.to(factor.device),
    )


def soft_edge(config: TrajectoryConfig, frames: int, rate: float) -> Tensor:
    """How much of each cosine of a window is left unpenalised, (K,); see ``trajectory_prior``."""
    rank = config.rank
    if config.edge != float("inf"):
        rank = round(rank * (frames / _REFERENCE_FRAMES) * (_REFERENCE_RATE / rate))
    rank = min(max(_STRAIGHT, rank), frames)
    order = torch.arange(rank, dtype=torch.float64)
    # penalty (1 - keep)^2 = (k / K)^(2 edge); a sharp edge keeps everything below K
    keep = (
        1 - config.step * (order / rank) ** config.edge
        if config.edge != float("inf")
        else order * 0 + 1
    )
    return keep


def angle_bounds(actor: Actor) -> Bounds:
    """Anatomical limits as hard bounds (Xu et al. 2018, Eq. 2)."""
    return Bounds.on_frames(*actor.skeleton.bounds)


def neutral_angles(actor: Actor) -> Tensor:
    """A relaxed standing pose inside the limits, (A,): where unseen angles rest."""
    angles = torch.zeros_like(actor.skeleton.lower)
    for index, name in enumerate(actor.skeleton.angle_names):
        if name.endswith(("elbow_flexion", "knee_flexion")):
            angles[index] = 0.25
    return angles.clamp(actor.skeleton.lower, actor.skeleton.upper)


def kernel(scale: float | None) -> Kernel:
    """Geman-McClure with a scale, in units of the residual; quadratic without."""
    return Quadratic() if scale is None else GemanMcClure(scale)
