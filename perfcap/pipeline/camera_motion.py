"""How a camera in a hand moved: its way behind a person, as long as the person's feet show it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.detections import Detections
from perfcap.errors import InputError
from perfcap.geometry.camera import Camera
from perfcap.matchmove import CameraWay, Ground
from perfcap.pipeline.config import PoseConfig
from perfcap.pipeline.initialize import initialize
from perfcap.pipeline.input_checks import require_kinds, require_matching
from perfcap.pipeline.objective import FrameProblem
from perfcap.pipeline.prepare import prepare, relaxed
from perfcap.pipeline.way_length import LAG, soles, standing
from perfcap.rates import frame_rate

_SPREAD, _RANGE = 0.5, 1.5  # of the log scale: its prior's deviation, and how far it is tried
_LEVEL = 0.25  # deviation of the log scale about what an exact ground says: one view's depth
_TRIES = 241


@dataclass(frozen=True)
class CameraMotion:
    """The way of one camera in metres.

    Attributes:
        rotation: world to camera, (F, 3, 3); the world is the first frame's camera.
        translation: the same, (F, 3), m.
        factor: of the assumed focal length.
        deviation: of its logarithm.
        explained: share of the corners behind the person that agree.
        up: normal of the ground, (3,), where it was among these corners.
    """

    rotation: Tensor
    translation: Tensor
    factor: float
    deviation: float
    explained: float
    up: Tensor | None = None

    def of_camera(self, cameras: Camera) -> Camera:
        """A camera that moves this way, (F, 1), from the fixed one that was assumed, (1,)."""
        moving = cameras.every_frame(len(self.rotation))
        lens = moving.intrinsics.clone()
        lens[..., :2, :2] *= self.factor
        turned = self.rotation[:, None].to(lens) @ moving.rotation
        shifted = (self.rotation[:, None].to(lens) @ moving.translation[..., None]).squeeze(-1)
        shifted = shifted + self.translation[:, None].to(lens)
        return replace(moving, intrinsics=lens, rotation=turned, translation=shifted)

    @property
    def reach(self) -> float:
        """Farthest that the camera is from where it began, m."""
        centre = (self.rotation.mT @ self.translation[..., None]).squeeze(-1)
        return float(centre.norm(dim=-1).max())

    @property
    def turn(self) -> float:
        """Most that it is turned from where it began, radians."""
        trace = self.rotation.diagonal(dim1=-2, dim2=-1).sum(-1)
        return float(((trace.amin() - 1) / 2).clamp(-1, 1).arccos())

    def report(self) -> dict[str, Any]:
        """Plain values, for run.json."""
        return {
            "factor": self.factor,
            "log_deviation": self.deviation,
            "explained": self.explained,
            "reach_m": self.reach,
            "turn_degrees": math.degrees(self.turn),
        }

    def sentence(self, cameras: Camera) -> str:
        """What a user should know; ``cameras`` are those assumed."""
        height, width = cameras.size[0]
        focal = float(cameras.intrinsics[0, 0, 0]) * self.factor
        angle = 2 * math.degrees(math.atan(0.5 * max(height, width) / focal))
        way = f"by {math.degrees(self.turn):.0f} degrees"
        if self.reach > 0:
            way += f" and {self.reach:.2g} m"
        return (
            f"the camera moves, {way} from where it began, and sees {angle:.0f} degrees: found by "
            "what is behind the person; --camera-motion none takes it to stand still"
        )


@torch.no_grad()
def in_metres(
    actor: Actor,
    cameras: Camera,
    detections: Detections,
    rate: float,
    way: CameraWay,
    ground: Ground | None = None,
    config: PoseConfig | None = None,
) -> CameraMotion:
    """A way with its length: that at which feet stand on the ground and slide least.

    The background shows a way up to one factor, but the person's size is known. The camera is as
    high above the ground as above the lower foot; and where it moves sideways, a foot that stands
    moves in the picture as what is behind it does not.

    Args:
        actor: any person's skeleton.
        cameras: one fixed view, with the assumed lens.
        detections: (F, 1, 16).
        rate: frames a second.
        way: of F frames.
        ground: among what it passes, where it is known.
        config: of the pose.

    Raises:
        InputError: several views, a camera that moves already, or a way of other frames.
    """
    require_kinds(actor=actor, cameras=cameras, detections=detections)
    rate, detections = frame_rate(rate), detections.finite()
    require_matching(cameras, detections, None)
    if cameras.views != 1 or cameras.moving or len(way.rotation) != detections.frame_count:
        raise InputError(
            f"camera motion: {cameras.views} views{', moving' if cameras.moving else ''}, a way of "
            f"{len(way.rotation)} frames for {detections.frame_count}; expected one fixed camera, "
            "and a way of its frames"
        )
    like = detections.joints2d
    known = CameraMotion(
        torch.from_numpy(way.rotation).to(like),
        torch.from_numpy(way.translation).to(like),
        *(way.factor, way.deviation, way.explained),
        None if ground is None else torch.from_numpy(ground.normal),
    )
    if not way.moves:
        return known
    lens = cameras.to(like).intrinsics.clone()
    lens[..., :2, :2] *= way.factor
    fixed = replace(cameras.to(like), intrinsics=lens)
    frames = FrameProblem.of(actor, fixed, detections, config or PoseConfig())
    motion, seen = initialize(prepare(relaxed(frames)))
    points = soles(actor, motion)
    about, spread = 0.0, _SPREAD
    if ground is not None:
        about, spread = _as_high(points[seen], known, seen, ground)
    scale = _least_slide(points, seen, known, rate, (about, spread))
    return replace(known, translation=scale * known.translation)


def _as_high(
    points: Tensor, way: CameraMotion, seen: Tensor, ground: Ground
) -> tuple[float, float]:
    """Log of the factor at which the lower of points (S, N, 3) is on the ground, and deviation.

    The median over frames. A tilt of the ground matters the more, the flatter it is looked at.
    """
    normal = torch.from_numpy(ground.normal).to(points)
    rotation = way.rotation[seen]
    centre = -(rotation.mT @ way.translation[seen][..., None]).squeeze(-1)
    lowest = -(points @ rotation @ normal)
    above, which = lowest.amax(-1), lowest.argmax(-1)  # m, of the camera above the lower foot
    known = centre @ normal - ground.height
    good = (above > 0) & (known > 0)
    if not bool(good.any()):
        return 0.0, _SPREAD
    far = points[torch.arange(len(points)), which].norm(dim=-1)
    steep = float((above / far)[good].median())
    about = float((above / known)[good].log().median())
    return about, min(_SPREAD, math.hypot(_LEVEL, ground.deviation / max(steep, 1e-3)))


def _least_slide(
    points: Tensor, seen: Tensor, way: CameraMotion, rate: float, prior: tuple[float, float]
) -> float:
    """The factor of a way at which points (F, N, 3) in axes of the cameras stand most.

    Args:
        points: under the feet.
        seen: frames that count, (F,).
        way: of the camera, with a wrong length.
        rate: frames a second.
        prior: mean and deviation of the log factor.
    """
    logs = prior[0] + torch.linspace(-_RANGE, _RANGE, _TRIES).to(points)
    stands = standing(points, seen, way.rotation, way.translation, rate, logs.exp())
    held = 0.5 * ((logs - prior[0]) / prior[1]).square()
    share = stands / (points.shape[1] * max(1, round(LAG * rate)))
    return float(logs[(share - held).argmax()].exp())
