"""What the motion of a clip is found from, and the objective of its windows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.pose_statistics import Mixture
from perfcap.detect.detections import Detections
from perfcap.energy.joint_position import JointPosition
from perfcap.energy.joint_target import JointTarget
from perfcap.energy.prior import PoseMixture
from perfcap.energy.trajectory import Trajectory
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.geometry.record import Record
from perfcap.pipeline.config import PoseConfig, TrajectoryConfig
from perfcap.pipeline.objective import FrameProblem, kernel, pose_objective, trajectory_prior
from perfcap.pipeline.standing import Standing
from perfcap.solve import Objective
from perfcap.solve.energy import Energy
from perfcap.temporal.window import Window

TERMS = ("joints2d", "joints3d", "targets", "trajectory", "prior")
"""Energies of a motion, by the names they are reported and weighed under."""

CONTACT = ("contact", "floor")
"""Energies of feet that stand, likewise; their weight is that of ``ContactConfig``."""

OPTIONAL = ("poses", "paths")
"""Energies that some settings add."""

_SMOOTH = ("trajectory", "prior", "poses")
_ROOT_DEVIATION = 0.05  # m, of where estimators put a whole person


@dataclass(frozen=True)
class FrameNumbers:
    """Which frames windows hold.

    Attributes:
        frames: numbers in their clip, (*b, W).
        clips: number of the clip of each window, (*b,): 0 in a capture, which has one.
    """

    frames: Tensor
    clips: Tensor


Term = Callable[[Actor, FrameNumbers], Energy[Motion]]
"""An author's own energy: of an actor, made anew for the windows that are solved together.

It sees motions (*b, W) of these windows, and its weight is its own.
"""


@dataclass(frozen=True)
class FirstSolve:
    """What a first solve of a clip tells the second.

    Attributes:
        starts: first frame of every window.
        stiffness: factors on the weights of translation, rotation and each angle in the trajectory
            prior of each window, (W, 2 + A).
        gain3d: factor on the weight of 3D joints.
        width3d: share of the variance in which their robust kernel is stated.
    """

    starts: tuple[int, ...]
    stiffness: Tensor
    gain3d: float
    width3d: float

    def of(self, window: Window) -> Tensor:
        """Stiffness of a window, (2 + A,)."""
        return self.stiffness[self.starts.index(window.start)]


@dataclass(frozen=True)
class ClipProblem:
    """What the motion of a clip is found from.

    Attributes:
        actor: gives the joints and the limits.
        cameras: C views, fixed or moving.
        detections: (F, C), prepared.
        config: windows, weights, units.
        pixel_unit: one percent of the person's height in each view, (C,), pixels.
        rate: frames a second.
        targets: places of the joints in the world by K sources, (F, K, 16, 3) m; None if not known.
        certain: confidence of the targets, (F, K, 16).
        calm: share of the weight of trajectory and prior that the clip's jitter asks for.
        first: what a first solve told; None before it.
        standing: where feet stand, as a first solve showed it.
        terms: an author's own energies by name.
        poses: recorded ones, where they are to count.
        factors: on the weights of energies, by name; learned ones may carry a graph.
        up: against gravity, a unit vector (3,); None where feet have to show it.
    """

    actor: Actor
    cameras: Camera
    detections: Detections
    config: PoseConfig
    pixel_unit: Tensor
    rate: float
    targets: Tensor | None = None
    certain: Tensor | None = None
    calm: float = 1.0
    first: FirstSolve | None = None
    standing: Standing | None = None
    terms: Mapping[str, Term] = field(default_factory=dict)
    poses: Mixture | None = None
    factors: Mapping[str, Tensor] = field(default_factory=dict)
    up: Tensor | None = None

    @classmethod
    def of(cls, frames: FrameProblem, rate: float) -> Self:
        """A clip of prepared frames."""
        given = frames.actor, frames.cameras, frames.detections, frames.config, frames.pixel_unit
        return cls(*given, rate)

    def apart(self, index: slice) -> FrameProblem:
        """Some frames of the clip, each on its own."""
        given = self.cameras, self.detections, self.config, self.pixel_unit
        return FrameProblem(self.actor, *given).frames(index)

    @property
    def frames(self) -> int:
        """F."""
        return self.detections.frame_count

    @property
    def tells_depth(self) -> bool:
        """Whether more than one view's pixels are known; else the first prior alone tells depth."""
        seen = self.detections
        return self.targets is not None or seen.views > 1 or seen.joints3d is not None

    @property
    def trajectory(self) -> TrajectoryConfig:
        """The temporal prior, but for its stiffness: that of the second solve after the first."""
        own, evidence = self.config.trajectory, self.config.evidence
        if self.first is None:
            return own
        return replace(own, rank=evidence.rank, edge=evidence.edge)

    def at(self, window: Window, clip: int = 0) -> WindowData:
        """What is known of a window of the clip."""
        like, first, index = self.pixel_unit, self.first, window.index
        return WindowData(
            cameras=self.cameras.frames(index),
            detections=self.detections.frames(index),
            numbers=torch.arange(window.start, window.stop, device=like.device),
            clip=torch.tensor(clip, device=like.device),
            pixel_unit=like,
            calm=like.new_tensor(self.calm),
            gain3d=like.new_tensor(1.0 if first is None else first.gain3d),
            width3d=like.new_tensor(1.0 if first is None else first.width3d),
            pixels=(self.detections.confidence2d > 0).any(),
            stiffness=None if first is None else first.of(window),
            targets=None if self.targets is None else self.targets[index],
            certain=None if self.certain is None else self.certain[index],
        )

    def objective(self, window: Window) -> Objective:
        """E_pose of one window, of motions (W,)."""
        return self.objective_of(self.at(window))

    def objective_of(self, windows: WindowData) -> Objective:
        """E_pose of windows (Xu et al. 2018, Eq. 3), of this clip or of others with its settings.

        Args:
            windows: of one length; with a batch *b the objective is of motions (*b, W).
        """
        frames = windows.numbers.shape[-1]
        prior = trajectory_prior(self.trajectory, frames, self.rate, windows.stiffness)
        energies = self._energies(windows, prior)
        for name, energy in energies.items():
            factor = self.factors.get(name)
            if factor is not None:
                energy.weight = energy.weight.to(factor) * factor
            if name in _SMOOTH:
                energy.weight = energy.weight.to(windows.calm) * windows.calm
        if self.standing is not None:
            energies.update(self.standing.energies(windows.numbers, self.config.contact))
        where = FrameNumbers(windows.numbers, windows.clip)
        for name, term in self.terms.items():
            own = term(self.actor, where)
            if not isinstance(own, Energy):
                raise InputError(
                    f"energies: {name!r} made a {type(own).__name__}, expected an Energy"
                )
            energies[name] = own.to(self.actor.skeleton.lower)
        return Objective(energies)

    def _energies(self, windows: WindowData, prior: Trajectory) -> dict[str, Energy[Motion]]:
        """Joints in images and in space, and what is known without them."""
        config, seen = self.config, windows.detections
        unit = windows.pixel_unit
        unit = unit.unsqueeze(-2) if unit.ndim > 1 else unit  # *b 1 C
        objective = pose_objective(self.actor, windows.cameras, seen, config, unit, prior)
        energies = dict(objective.items())
        if windows.targets is not None and windows.certain is not None:
            if not bool(windows.pixels.any()):  # all there is to know is in the targets
                del energies["joints2d"]
                energies.pop("joints3d", None)
            places, certain = windows.targets, windows.certain
            energies["targets"] = targets_energy(self.actor, places, certain, config)
        if self.poses is not None:
            weight = config.prior.poses * config.prior.weight
            energies["poses"] = PoseMixture(self.poses, weight).to(self.actor.skeleton.lower)
        if "joints3d" in energies:
            _resize(energies["joints3d"], windows)
        return energies


@dataclass(frozen=True)
class WindowData(Record):
    """What is known of a window of W frames, or of a batch *b of windows.

    Attributes:
        cameras: C views, (C,) of all windows, or (*b, W, C).
        detections: (*b, W, C).
        numbers: of the frames, (*b, W).
        clip: number of the clip, (*b,).
        pixel_unit: (*b, C), pixels.
        calm: see ``ClipProblem``, (*b,).
        gain3d: see ``FirstSolve``, (*b,).
        width3d: see ``FirstSolve``, (*b,).
        pixels: whether any joint of the clip is seen in an image, (*b,), bool.
        stiffness: see ``FirstSolve``, (*b, 2 + A); None before a first solve.
        targets: (*b, W, K, 16, 3), metres; None where they are not known.
        certain: (*b, W, K, 16).
    """

    cameras: Camera
    detections: Detections
    numbers: Tensor
    clip: Tensor
    pixel_unit: Tensor
    calm: Tensor
    gain3d: Tensor
    width3d: Tensor
    pixels: Tensor
    stiffness: Tensor | None = None
    targets: Tensor | None = None
    certain: Tensor | None = None

    @classmethod
    def stack(cls, records: Sequence[Self]) -> Self:
        """Windows of one length as a batch; fixed cameras that they share stay as they are."""
        first = records[0]
        stacked = super().stack(records)
        shared = all(each.cameras is first.cameras for each in records)
        if shared and not first.cameras.moving:
            cameras = first.cameras
        else:
            frames = first.numbers.shape[-1]
            cameras = Camera.stack(
                alike_cameras([each.cameras.every_frame(frames) for each in records])
            )
        seen = [each.detections for each in records]
        if any(each.joints3d is None for each in seen):
            seen = [replace(each, joints3d=None) for each in seen]
        return replace(stacked, cameras=cameras, detections=Detections.stack(seen))


def targets_energy(
    actor: Actor, points: Tensor, certain: Tensor, config: PoseConfig
) -> JointTarget:
    """Distance from places (*b, F, K, 16, 3) that an estimator gives, with confidence."""
    own = points.new_tensor(config.position.deviation)
    unit = (own.square() + _ROOT_DEVIATION**2).sqrt()
    robust = kernel(config.position.scale)
    return JointTarget(actor.landmarks, points, certain, config.position.weight, robust, unit)


def _resize(energy: Energy[Motion], windows: WindowData) -> None:
    """Give 3D joints the weight and the kernel of their clip's errors.

    A kernel of squared width w is that of width 1 of residuals divided by w, times w.
    """
    assert isinstance(energy, JointPosition)
    width = windows.width3d
    energy.confidence = energy.confidence / width[..., None, None]
    energy.weight = energy.weight.to(width) * windows.gain3d * width


def alike_cameras(cameras: list[Camera]) -> list[Camera]:
    """Cameras that all have a lens distortion, if any has one."""
    if all(each.distortion is None for each in cameras):
        return cameras
    return [
        each
        if each.distortion is not None
        else replace(each, distortion=each.translation.new_zeros(*each.translation.shape[:-1], 5))
        for each in cameras
    ]
