"""How long the way of a moving camera is: feet that stand in the picture say so."""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.sole_points import SIDES, SOLE_POINTS, sole_skeleton
from perfcap.geometry.camera import Camera

_POINTS = len(SIDES) * len(SOLE_POINTS)
LAG = 0.4
"""s, over which a foot stands or does not."""
_STILL = 0.02  # m, of a point that stands, across the line of sight
_MOST, _TRIED = math.log(2000.0), 305  # log factors of a given way
_OTHER = 2.0  # times as long or short, at least
_STANDS, _MORE = 0.015, 1.6  # share of the points that stand then, and times as many as given


def soles(actor: Actor, motion: Motion) -> Tensor:
    """Points under the feet, (F, 8, 3), metres."""
    landmarks: Tensor = sole_skeleton(actor)(motion).landmarks
    return landmarks[..., -_POINTS:, :]


def standing(
    points: Tensor, seen: Tensor, rotation: Tensor, translation: Tensor, rate: float, factor: Tensor
) -> Tensor:
    """How many points stand over 0.4 s if a camera's way is so many times as long, (K,).

    What moves along the line of sight is not looked at: one view's depth trembles.

    Args:
        points: under the feet, in the axes of the camera, (F, N, 3) m.
        seen: frames that count, (F,).
        rotation: world to camera, (F, 3, 3).
        translation: the same, (F, 3), m.
        rate: frames a second.
        factor: of the way, (K,).

    Returns:
        Frames in which a point stands, of all points.
    """
    lag = max(1, round(LAG * rate))
    place = points @ rotation  # world axes, from where the camera is
    centre = (rotation.mT @ translation[..., None]).squeeze(-1)  # minus where the camera stands
    both = seen[lag:] & seen[:-lag]
    moved, shift = place[lag:] - place[:-lag], centre[lag:] - centre[:-lag]
    across = rotation[:-lag][both][:, None, :2]  # 1 2 3 of each frame
    moved = (across @ moved[both][..., None]).squeeze(-1)
    shift = (across @ shift[both][:, None, :, None]).squeeze(-1)

    def count(each: Tensor) -> Tensor:  # one by one: of a long clip all together fill the memory
        slid = (moved - each * shift).square().sum(-1) / _STILL**2
        return (1 / (1 + slid)).sum()

    return torch.stack([count(each) for each in factor])


@torch.no_grad()
def way_doubts(actor: Actor, motion: Motion, cameras: Camera, rate: float) -> Iterator[str]:
    """A sentence where feet would stand if the way of one moving camera were longer or shorter.

    A person moves with the camera's way where it is too long. Of several views their agreement
    says so.

    Args:
        actor: whose feet.
        motion: as captured, (F,).
        cameras: C views, (C,) or (F, C).
        rate: frames a second.
    """
    if cameras.views != 1 or not cameras.moving:
        return
    like = cameras.every_frame(motion.frames).map(Tensor.double)
    points = like.to_camera(soles(actor, motion).to(like.rotation))[:, 0]
    every = torch.ones(len(points), dtype=torch.bool, device=points.device)
    logs = torch.linspace(-_MOST, _MOST, _TRIED).to(points)
    factors = torch.cat((logs.new_tensor([0.0, 1.0]), logs.exp()))
    way = like.rotation[:, 0], like.translation[:, 0]
    still, given, *tried = standing(points, every, *way, rate, factors).tolist()
    most = max(tried)
    factor = math.exp(float(logs[tried.index(most)]))
    least = _STANDS * (len(points) - round(LAG * rate)) * _POINTS
    # who rides beside the camera stands at a way of no length
    if most > max(least, _MORE * given, _MORE * still) and not 1 / _OTHER < factor < _OTHER:
        yield (
            f"feet would stand if the camera's way were {factor:.2g} times as long, and slide as "
            "it is; check its unit: ways that videos show (COLMAP, SLAM) have none of their own, "
            "and are to be scaled to metres"
        )
