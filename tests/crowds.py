"""People who walk through the same place, and detections of them with planted mistakes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from takes import F64, marked_template, sway
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix

RATE = 30.0
NOBODY = -1
_LIMBS = [
    [LANDMARKS.index(f"{side}_{joint}") for joint in joints]
    for side in "lr"
    for joints in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle", "toe"))
]


@dataclass(frozen=True)
class Crowd:
    """Candidates of several people, and who they are.

    Attributes:
        actors: the people, K.
        motions: of each, (F,).
        cameras: C views.
        candidates: (P, F, C, 16).
        owner: whom each candidate shows, (P, F, C); -1 for others and for nobody.
        right: whether a candidate has no planted mistake, (P, F, C).
    """

    actors: tuple[Actor, ...]
    motions: tuple[Motion, ...]
    cameras: Camera
    candidates: Detections
    owner: NDArray[np.int64]
    right: NDArray[np.bool_]

    @property
    def joints(self) -> Tensor:
        """True landmarks, (K, F, 16, 3)."""
        pairs = zip(self.actors, self.motions, strict=True)
        return torch.stack([actor.joints(motion) for actor, motion in pairs])

    def matched(self, slots: Tensor) -> tuple[list[int], NDArray[np.int64]]:
        """The true person of each found one, by most slots (K, F, C), and whom each slot shows.

        -1 where a slot shows somebody else, -2 where there is none.
        """
        at = slots.numpy()
        who = np.take_along_axis(self.owner, np.maximum(at, 0), 0)
        who = np.where(at >= 0, who, -2)
        return [int(np.bincount(each[each >= 0]).argmax()) for each in who], who


@cache
def walkers(
    count: int, frames: int, gap: float = 0.45
) -> tuple[tuple[Actor, ...], tuple[Motion, ...]]:
    """People of different size whose ways cross, ``gap`` m beside each other."""
    actors, motions = [], []
    for k in range(count):
        body = Actor(marked_template())
        size = torch.full(
            (len(body.skeleton.group_names),), 0.07 * (k - (count - 1) / 2), dtype=F64
        )
        body = body.resized(size)
        plain = sway(body, frames, most=0.43)
        way = 2 * math.pi * k / count + 0.3
        ahead = torch.tensor([math.sin(way), 0.0, math.cos(way)], dtype=F64)
        beside = torch.tensor([math.cos(way), 0.0, -math.sin(way)], dtype=F64)
        time = (torch.arange(frames, dtype=F64)[:, None] - (frames - 1) / 2) / RATE
        place = plain.translation * torch.tensor([0.2, 1.0, 0.2], dtype=F64)
        place = place + 1.2 * time * ahead + gap * beside
        turn = plain.rotation * 0.3 + torch.tensor([0.0, way, 0.0], dtype=F64)
        actors.append(body)
        motions.append(Motion(place, turn, plain.angles))
    return tuple(actors), tuple(motions)


def circle(views: int, size: int = 700) -> Camera:
    """Cameras 4.5 m from the middle at different heights, not facing each other."""
    angle = [2 * math.pi * (k + 0.3 * (k % 2)) / views + 0.4 for k in range(views)]
    turn = torch.tensor([[0.0, a, 0.0] for a in angle], dtype=F64)
    tilt = torch.tensor(
        [[math.pi + 0.08 + 0.06 * (k % 3), 0.0, 0.0] for k in range(views)], dtype=F64
    )
    rotation = rotvec_to_matrix(tilt) @ rotvec_to_matrix(turn)
    looked = torch.tensor([0.0, 1.0, 0.0], dtype=F64)
    shift = torch.tensor([0.0, 0.0, 4.5], dtype=F64) - rotation @ looked
    focal = torch.tensor([[size, 0, size / 2], [0, size, size / 2], [0, 0, 1]], dtype=F64)
    return Camera(focal.expand(views, 3, 3), rotation, shift, None, ((size, size),) * views)


def make_crowd(
    seed: int = 0,
    *,
    count: int = 2,
    frames: int = 40,
    views: int = 4,
    size: int = 700,
    noise: float = 3.0,
    spoil: float = 0.0,
    stranger: bool = False,
    away: Sequence[slice] = (),
) -> Crowd:
    """Shuffled detections of walkers.

    Args:
        seed: of noise, order and mistakes.
        count: K.
        frames: F.
        views: C.
        size: of the square images, px.
        noise: of joints, px of an image of 700.
        spoil: share of frames and views in which something is wrong: a limb exchanged between two
            people, one person listed twice and another not at all, one not at all. Two views of
            everybody are right in every frame.
        stranger: whether the first view lists somebody else in every frame.
        away: frames in which each person is not there.
    """
    random = np.random.default_rng(seed)
    actors, motions = walkers(count, frames)
    cameras = circle(views, size)
    joints = torch.stack([a.joints(m) for a, m in zip(actors, motions, strict=True)])
    pixels = cameras.project(joints).numpy()  # K F C J 2
    pixels = pixels + noise * size / 700 * random.standard_normal(pixels.shape)
    trust = random.uniform(0.6, 0.95, pixels.shape[:-1])
    owner = np.broadcast_to(np.arange(count)[:, None, None], pixels.shape[:3]).copy()
    right = np.ones(owner.shape, bool)
    for k, span in enumerate(away):
        trust[k, span] = 0
        owner[k, span] = NOBODY
    for frame in range(frames):
        for view in random.permutation(views)[: max(0, views - 2)]:
            if random.random() < spoil * views / max(1, views - 2):
                _spoil(random, pixels[:, frame, view], trust[:, frame, view],
                       owner[:, frame, view], right[:, frame, view])  # fmt: skip
    if stranger:
        other = pixels[:1] + size / 700 * np.array([170.0, -40.0])
        trust = np.concatenate((trust, np.zeros_like(trust[:1])))
        trust[-1, :, 0] = 0.8
        pixels = np.concatenate((pixels, other))
        owner = np.concatenate((owner, np.full_like(owner[:1], NOBODY)))
        right = np.concatenate((right, np.ones_like(right[:1])))
    order = np.argsort(random.random(owner.shape), 0)
    pixels = np.take_along_axis(pixels, order[..., None, None], 0)
    trust = np.take_along_axis(trust, order[..., None], 0)
    pixels = np.where(trust[..., None] > 0, pixels, 0)
    candidates = Detections.from_joints(torch.from_numpy(pixels), torch.from_numpy(trust))
    owner, right = (np.take_along_axis(each, order, 0) for each in (owner, right))
    return Crowd(actors, motions, cameras, candidates, owner, right)


def _spoil(
    random: np.random.Generator,
    pixels: NDArray[np.float64],
    trust: NDArray[np.float64],
    owner: NDArray[np.int64],
    right: NDArray[np.bool_],
) -> None:
    """Plant a mistake in the detections of one frame and view, in place."""
    one, other = random.permutation(len(pixels))[:2] if len(pixels) > 1 else (0, 0)
    kind = random.integers(3)
    if kind == 0:  # a limb of two people exchanged
        limb = _LIMBS[random.integers(len(_LIMBS))]
        pixels[[one, other], limb[0] : limb[-1] + 1] = pixels[[other, one], limb[0] : limb[-1] + 1]
        right[[one, other]] = False
    elif kind == 1:  # one listed twice, the other missing
        pixels[other] = pixels[one] + 1e-3 * np.ptp(pixels[one]) * random.standard_normal(
            pixels[one].shape
        )
        owner[other] = owner[one]
        right[[one, other]] = False
    else:  # missed
        trust[one] = 0
        owner[one] = NOBODY
        right[one] = False


def without_owner(crowd: Crowd, view: int) -> Crowd:
    """A view that sees nobody."""
    trust = crowd.candidates.confidence2d.clone()
    trust[:, :, view] = 0
    owner = crowd.owner.copy()
    owner[:, :, view] = NOBODY
    return replace(crowd, candidates=replace(crowd.candidates, confidence2d=trust), owner=owner)
