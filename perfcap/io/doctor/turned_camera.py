"""Two calibrated views of which one was turned since: a tripod that was knocked."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.io.doctor.evidence import Scene, disagreement

LIKELIER = 1.5  # times what is left by a turn, that another mistake must leave: it has no unknowns
_MOST = 12.0  # degrees; who turns a camera by more points it elsewhere
_STEPS = 4
_TRIED = 1e-4  # rad, of differences


@dataclass(frozen=True)
class TurnedCamera:
    """A view, by how much it would have to be turned, and the disagreement that this leaves.

    Attributes:
        view: its number.
        turn: rotation vector in its own axes, (3,), radians.
        rest: pixels.
    """

    view: int
    turn: Tensor
    rest: float

    @property
    def degrees(self) -> float:
        """Of the turn."""
        return math.degrees(float(self.turn.norm()))

    def undo(self, scene: Scene) -> Scene:
        """A scene with the camera as it stands."""
        return _turned(scene, self.view, self.turn)


def turned_camera(scene: Scene) -> TurnedCamera | None:
    """The camera that makes two views agree best once it is turned; None of no small turn.

    Of two views it is not known which one was: a turn of either fits much alike.

    Args:
        scene: of two views.
    """
    few, found = scene.sampled(), []
    for view in range(few.detections.views):
        turn = _best_turn(few, view)
        found.append(TurnedCamera(view, turn, disagreement(_turned(few, view, turn))))
    best = min(found, key=lambda each: each.rest)
    return best if best.degrees < _MOST else None


def _best_turn(scene: Scene, view: int) -> Tensor:
    """The turn of a view that leaves least of the residuals of joints, outliers apart, (3,)."""
    turn = scene.cameras.translation.new_zeros(3)
    for _ in range(_STEPS):
        now = _residuals(_turned(scene, view, turn))
        steps = _TRIED * torch.eye(3).to(turn)
        tried = [_residuals(_turned(scene, view, turn + step)) for step in steps]
        slope = (torch.stack(tried, -1) - now[:, None]) / _TRIED
        usual = now.abs().median().clamp(min=1e-6)
        weight = 1 / (1 + (now / (2 * usual)).square())
        # a turn along the lines between both cameras shows hardly, and stays small
        held = 1e-5 * weight.sum() * torch.eye(3).to(turn)
        turn = turn - torch.linalg.solve(
            slope.mT @ (weight[:, None] * slope) + held, slope.mT @ (weight * now)
        )
    return turn


def _residuals(scene: Scene) -> Tensor:
    """Of joints that both views see, along both axes of both images, on the plane, (N,)."""
    points, _ = scene.triangulated(rounds=0)
    seen = (scene.detections.confidence2d > 0).all(1)
    cameras, pixels = scene.cameras, scene.detections.joints2d
    apart = cameras.to_plane(cameras.project(points.nan_to_num())) - cameras.to_plane(pixels)
    return apart.transpose(1, 2)[seen].flatten().nan_to_num()


def _turned(scene: Scene, view: int, turn: Tensor) -> Scene:
    step = turn.new_zeros(scene.cameras.views, 6)
    step[view, :3] = turn
    return replace(scene, cameras=scene.cameras.nudged(step))
