"""The focal length of one camera that was not calibrated, as far as a moving person shows it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.energy.uncertain_views import LENS
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.input_checks import require_kinds, require_matching
from perfcap.pipeline.liveliness import liveliest
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare, relaxed
from perfcap.pipeline.uncertain_problem import UncertainProblem
from perfcap.rates import frame_rate
from perfcap.setting_checks import Settings

_JOINTS = 7  # that a frame shows at least to count


@dataclass(frozen=True)
class LensConfig(Settings):
    """How a focal length is found.

    Attributes:
        frames: the liveliest stretch of so many is looked at.
        fewest: frames with a 3D pose and enough joints, below which nothing is shown.
        spread: deviation of the log focal length of unknown cameras about the assumed one: phones
            have lenses between 0.5 and 2 times their main one.
        steps: of the solver.
        shown: deviations by which the log focal length must be above the assumed one to count.
            What looks like a shorter one is more often a limb whose depth is wrong.
    """

    frames: int = 150
    fewest: int = 15
    spread: float = 0.4
    steps: int = 60
    shown: float = 1.5


@dataclass(frozen=True)
class Lens:
    """A focal length as a motion shows it.

    Attributes:
        factor: of the assumed focal length, 1 where nothing is shown.
        deviation: of its logarithm.
        shown: whether the motion shows more than was assumed.
    """

    factor: float
    deviation: float
    shown: bool

    def of_camera(self, cameras: Camera) -> Camera:
        """A camera with this lens."""
        longer = cameras.intrinsics.clone()
        longer[..., :2, :2] *= self.factor
        return replace(cameras, intrinsics=longer)

    def report(self) -> dict[str, Any]:
        """Plain values."""
        return {"factor": self.factor, "log_deviation": self.deviation, "shown": self.shown}

    def sentence(self, cameras: Camera) -> str:
        """What a user should know; ``cameras`` are those assumed."""
        height, width = cameras.size[0]
        half, focal = 0.5 * max(height, width), float(cameras.intrinsics[0, 0, 0])

        def angle(factor: float) -> float:
            return 2 * math.degrees(math.atan(half / (focal * factor)))

        if not self.shown:
            return f"the motion shows no other lens than the assumed {angle(1):.0f} degrees"
        wide, narrow = (angle(self.factor * math.exp(s * self.deviation)) for s in (-1, 1))
        return (
            f"the motion shows a lens of {angle(self.factor):.0f} degrees ({narrow:.0f} to "
            f"{wide:.0f}) instead of the assumed {angle(1):.0f}; --fov says another"
        )


@torch.no_grad()
def solve_lens(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    rate: float,
    config: PoseConfig | None = None,
    settings: LensConfig | None = None,
) -> Lens:
    """Find a focal length longer than assumed with the motion and bone lengths of a stretch.

    The limbs that are nearer look larger by their distance, not by the lens, and a person who
    comes nearer on level ground goes down in the picture: with 3D poses that tells the distance,
    and with it the lens. It is held by a Gaussian about the assumed one.

    Args:
        actor: any person's skeleton.
        cameras: one fixed view, with the assumed lens.
        detections: (F, 1, 16), with 3D poses; without them nothing is shown.
        rate: frames a second.
        config: of the pose.
        settings: of the search.

    Raises:
        InputError: several views, or a camera that moves.
    """
    config, settings = config or PoseConfig(), settings or LensConfig()
    require_kinds(actor=actor, cameras=cameras, detections=detections)
    rate, detections = frame_rate(rate), detections.finite()
    require_matching(cameras, detections, None)
    if cameras.views != 1 or cameras.moving:
        raise InputError(
            f"lens: {cameras.views} views{', moving' if cameras.moving else ''}; expected one "
            "fixed camera"
        )
    nothing = Lens(1.0, settings.spread, shown=False)
    part = detections.frames(liveliest(detections, settings.frames))
    posed = part.trusted3d[:, 0] & ((part.confidence2d[:, 0] > 0).sum(-1) >= _JOINTS)
    if int(posed.sum()) < settings.fewest:
        return nothing
    frames = FrameProblem.of(actor, cameras.to(part.joints2d), part, config)
    prepared = prepare(relaxed(frames))
    motion, _ = initialize(prepared)
    spread = {LENS: part.joints2d.new_tensor([settings.spread])}
    problem = UncertainProblem(prepared.problem, rate, spread, settings.steps)
    state = problem.solved(motion, {LENS: motion.angles.new_zeros(1)}, {})
    value, deviation = float(state.shared[LENS]), float(problem.deviations(state)[LENS])
    if not value > settings.shown * deviation:
        return nothing
    return Lens(math.exp(value), deviation, shown=True)
