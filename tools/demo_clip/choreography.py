"""Motion for the demo: a recording fitted, carried over to the actor, and set on the floor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import butter, filtfilt
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Skeleton
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.alignment import procrustes
from perfcap.geometry.rotation import (
    aligned,
    matrix_to_rotvec,
    quaternion_to_rotvec,
    rotvec_to_quaternion,
)
from perfcap.solve.bounds import Bounds
from perfcap.solve.energy import Energy, Linearization, Objective, Residual
from perfcap.solve.levenberg_marquardt import LevenbergMarquardt
from perfcap.solve.minimize import solve

Floats = NDArray[np.float64]

TRUNK = [LANDMARKS.index(n) for n in ("neck", "r_shoulder", "l_shoulder", "r_hip", "l_hip")]
FEET = [[LANDMARKS.index(f"{side}_{part}") for part in ("ankle", "toe")] for side in "rl"]
CUTOFF = 6.0  # Hz; nothing a dancer does on purpose is faster
STIFFNESS = 0.003  # m per rad: settles the twists that landmarks do not show
SETTLE = 0.015  # m per rad towards the smoothed angles
NEIGHBOURS = (1, -1, 3, -3, 8, -8)  # frames away
KEEP = 0.05  # m per rad: how firmly the carried-over angles stand against the floor
PLANTED_SPEED, PLANTED_HEIGHT = 0.5, 0.16  # m/s of the ankle and m above its resting height
HOLD = 6.0  # weight of a planted foot's landmarks over the others'
BENT = 0.25  # rad, knees and elbows before the fit: straight limbs know no way to bend


class Towards(Energy[Motion]):
    """Pull landmarks to places and angles to values, frame by frame.

    Args:
        skeleton: whose landmarks.
        places: (F, 16, 3), metres.
        weights: of the places, (F, 16).
        angles: (F, A), radians.
        stiffness: metres for a radian.
    """

    def __init__(
        self, skeleton: Skeleton, places: Tensor, weights: Tensor, angles: Tensor, stiffness: float
    ) -> None:
        super().__init__()
        self.skeleton, self.stiffness = skeleton, stiffness
        self.places, self.weights, self.angles = places, weights[..., None], angles

    def residual(self, state: Motion) -> Residual:
        """(F, 16 + A, 3): an angle fills one coordinate of its group."""
        points = self.weights * (self.skeleton(state).landmarks - self.places)
        bend = self.stiffness * (state.angles - self.angles)
        padded = torch.nn.functional.pad(bend[..., None], (0, 2))
        return Residual(torch.cat((points, padded), -2))

    def linearize(self, state: Motion) -> Linearization:
        """In closed form, from the skeleton's."""
        _, jacobian, _ = self.skeleton.linearize(state)
        count = state.angles.shape[-1]
        bend = jacobian.new_zeros(count, 3, 6 + count)
        bend[:, 0, 6:] = self.stiffness * torch.eye(count).to(bend)
        bend = bend.expand(*jacobian.shape[:-3], count, 3, 6 + count)
        rows = torch.cat((self.weights[..., None] * jacobian, bend), -3)
        return Linearization(self.residual(state), rows)


def fit(skeleton: Skeleton, places: Tensor, rate: float) -> Motion:
    """The skeleton's motion through recorded landmarks (F, 16, 3) m.

    Frames are fitted on their own, then from their neighbours' angles wherever that is better (an
    arm overhead has more than one local minimum), then towards the smoothed angles, which settles
    the twist of straight limbs.
    """
    weights = torch.ones_like(places[..., 0])
    start = _upright(skeleton, places)
    loose = Towards(skeleton, places, weights, start.angles, STIFFNESS)
    best = _solve(skeleton, loose, start)
    for away in NEIGHBOURS:
        near = (torch.arange(len(places)) + away).clamp(0, len(places) - 1)
        other = _solve(skeleton, loose, replace(best, angles=best.angles[near]))
        best = _better(loose, best, other)
    calm = torch.tensor(low_pass(best.angles.numpy(), rate, 2.0))
    return _solve(skeleton, Towards(skeleton, places, weights, calm, SETTLE), best)


def _upright(skeleton: Skeleton, places: Tensor) -> Motion:
    """The trunk at its landmarks, limbs hanging and slightly bent."""
    rest = skeleton.rest_landmarks[TRUNK].expand(len(places), -1, -1)
    placed = procrustes(rest, places[:, TRUNK], scale=False)
    root = placed.rotation @ skeleton.rest_positions[0] + placed.translation
    bending = ("elbow_flexion", "knee_flexion")
    bent = [BENT if name.endswith(bending) else 0.0 for name in skeleton.angle_names]
    angles = places.new_tensor(bent).expand(len(places), -1)
    return Motion(root, matrix_to_rotvec(placed.rotation), angles)


def _better(energy: Towards, one: Motion, other: Motion) -> Motion:
    """Of two motions the better in each frame."""
    first, second = (energy.residual(m).value.square().sum((-2, -1)) for m in (one, other))
    take = (second < first)[:, None]
    return Motion(
        torch.where(take, other.translation, one.translation),
        torch.where(take, other.rotation, one.rotation),
        torch.where(take, other.angles, one.angles),
    )


@dataclass(frozen=True)
class Soles:
    """How high the middle of the ankle and the toe are above the floor when a foot is flat, m."""

    ankle: float
    toe: float


def carry_over(
    motion: Motion, subject: Skeleton, floor: float, actor: Actor, rate: float
) -> Motion:
    """A subject's motion on an actor: same angles, paths in proportion to the legs, feet planted.

    Where a foot of the subject rests, the actor's stands still with its toes on the floor; its
    heel lifts as much as the subject's. The floor is at height 0 and is never left: this is for
    walks and dances, not for leaps.

    Args:
        motion: of the subject, smooth.
        subject: whose motion it is.
        floor: height of the ankles when the subject's feet are flat, m.
        actor: who is to move.
        rate: frames a second.
    """
    skeleton = actor.skeleton
    scale = _leg(skeleton) / _leg(subject)
    moved = Motion(scale * motion.translation, motion.rotation, motion.angles)
    moved = grounded(actor, _within(skeleton, moved), rate)
    places, weights = _planted(subject(motion).landmarks.numpy(), floor, moved, actor, rate)
    pull = Towards(skeleton, places, weights, moved.angles, KEEP)
    standing = smooth(skeleton, _solve(skeleton, pull, moved), rate)
    return centred(skeleton, grounded(actor, standing, rate))


def grounded(actor: Actor, motion: Motion, rate: float) -> Motion:
    """Move up and down, smoothly, so that the lowest point of the surface is at height 0."""
    with torch.no_grad():
        lowest = actor.surface(motion)[..., 1].amin(-1)
    return _shifted(motion, y=-torch.tensor(low_pass(lowest.numpy(), rate, 4.0)))


def centred(skeleton: Skeleton, motion: Motion) -> Motion:
    """Put the middle of the space that a motion takes over the origin."""
    points = skeleton(motion).landmarks.reshape(-1, 3)
    x, _, z = (-0.5 * (points.amin(0) + points.amax(0))).unbind()
    return _shifted(motion, x=x, z=z)


def smooth(skeleton: Skeleton, motion: Motion, rate: float) -> Motion:
    """Low-pass a motion forwards and backwards, within the limits of its angles."""

    def passed(values: Tensor) -> Tensor:
        return torch.tensor(low_pass(values.numpy(), rate))

    turn = passed(aligned(rotvec_to_quaternion(motion.rotation)))
    rotation = quaternion_to_rotvec(torch.nn.functional.normalize(turn, dim=-1))
    return _within(skeleton, Motion(passed(motion.translation), rotation, passed(motion.angles)))


def low_pass(values: Floats, rate: float, cutoff: float = CUTOFF) -> Floats:
    """Zero-phase fourth-order Butterworth along the first axis."""
    b, a = butter(4, 2 * cutoff / rate)
    passed: Floats = filtfilt(b, a, values, axis=0).copy()
    return passed


def _solve(skeleton: Skeleton, energy: Towards, start: Motion) -> Motion:
    bounds = Bounds.on_frames(*skeleton.bounds)
    return solve(Objective(towards=energy), start, LevenbergMarquardt(max_steps=60), bounds).state


def _within(skeleton: Skeleton, motion: Motion) -> Motion:
    angles = motion.angles.clamp(skeleton.lower, skeleton.upper)
    return Motion(motion.translation, motion.rotation, angles)


def _leg(skeleton: Skeleton) -> float:
    rest = skeleton.rest_landmarks
    hip, knee, ankle = (rest[LANDMARKS.index(f"r_{n}")] for n in ("hip", "knee", "ankle"))
    return float((hip - knee).norm() + (knee - ankle).norm())


def _shifted(
    motion: Motion,
    x: Tensor | float = 0.0,
    y: Tensor | float = 0.0,
    z: Tensor | float = 0.0,
) -> Motion:
    like = motion.translation[..., 0]
    offset = torch.stack([torch.as_tensor(part).to(like).expand_as(like) for part in (x, y, z)], -1)
    return replace(motion, translation=motion.translation + offset)


def _planted(
    source: Floats, floor: float, moved: Motion, actor: Actor, rate: float
) -> tuple[Tensor, Tensor]:
    """Places (F, 16, 3) and weights (F, 16) of the actor's landmarks with resting feet at rest."""
    skeleton = actor.skeleton
    places = skeleton(moved).landmarks.clone()
    weights = torch.ones_like(places[..., 0])
    soles = _soles(actor)
    for ankle, toe in FEET:
        lift = source[:, ankle, 1] - floor
        still = _still(source[:, ankle], lift, rate)
        target = _resting(places[:, [ankle, toe]].numpy(), still)
        target[:, 0, 1] = soles.ankle + np.clip(lift, 0, None)
        target[:, 1, 1] = soles.toe
        share = torch.tensor(_eased(still, rate))[:, None]
        wanted = torch.tensor(target)
        places[:, [ankle, toe]] = torch.lerp(places[:, [ankle, toe]], wanted, share[..., None])
        weights[:, [ankle, toe]] = 1 + (HOLD - 1) * share
    return places, weights


def _soles(actor: Actor) -> Soles:
    above = actor.skeleton.rest_landmarks[:, 1] - actor.vertices[:, 1].min()
    (right_ankle, right_toe), (left_ankle, left_toe) = FEET
    return Soles(
        float(above[[right_ankle, left_ankle]].mean()), float(above[[right_toe, left_toe]].mean())
    )


def _still(ankle: Floats, lift: Floats, rate: float) -> NDArray[np.bool_]:
    speed = np.linalg.norm(np.gradient(ankle, axis=0), axis=-1) * rate
    resting: NDArray[np.bool_] = (speed < PLANTED_SPEED) & (lift < PLANTED_HEIGHT)
    return resting


def _resting(foot: Floats, still: NDArray[np.bool_]) -> Floats:
    """Places of a foot's two landmarks (F, 2, 3), unmoving while it is still."""
    result = foot.copy()
    starts = np.flatnonzero(np.diff(still.astype(int), prepend=0) > 0)
    for start in starts:
        run = slice(start, start + int(np.argmin(np.append(still[start:], False))))
        result[run] = np.median(foot[run], axis=0)
    return result


def _eased(still: NDArray[np.bool_], rate: float) -> Floats:
    """A share in [0, 1] that rises before and falls after, within a tenth of a second or so."""
    return np.clip(low_pass(still.astype(float), rate, 3.0), 0, 1)
