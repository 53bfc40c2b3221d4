"""Joints in motion without angles and limits, and what another skeleton should make of them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS, human_rig
from perfcap.actor.skeleton import Skeleton
from perfcap.actor.sole_points import SOLE_POINTS, sole_skeleton
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.joint_moments import moment_doubts
from perfcap.pipeline.rest_stance import upright_turn

SOLES = 2 * len(SOLE_POINTS)
LIMBS = tuple(
    (f"{side}_{start}", f"{side}_{end}")
    for side in "lr"
    for start, end in (
        ("shoulder", "elbow"),
        ("elbow", "wrist"),
        ("hip", "knee"),
        ("knee", "ankle"),
    )
)
ARMS = tuple((f"{side}_shoulder", f"{side}_wrist") for side in "lr")
_SHORTEST = 1e-9
_UNITS = 10.0  # times; centimetres, inches and millimetres are more
_ALIKE = 1.5  # times; above it, joints are of another skeleton
_SKEWED = 0.05  # of a rotation's rows; low precision leaves a hundredth
_STEEP, _NEARLY, _FEWEST = 0.5, 0.95, 5  # cosine to y, of the frames, frames that say something


@dataclass(frozen=True)
class JointMotion:
    """Joints of a skeleton in motion, free of angles and limits.

    Attributes:
        rotation: rest-to-posed rotations in the world, (F, 16, 3, 3).
        position: in the world, (F, 16, 3), metres.

    Raises:
        InputError: other shapes, no frame, what is no number, or rotations that are none.
    """

    rotation: Tensor
    position: Tensor

    def __post_init__(self) -> None:
        shape, count = tuple(self.position.shape), len(JOINTS)
        fits = len(shape) == 3 and shape[0] and shape[1:] == (count, 3)
        if not fits or tuple(self.rotation.shape) != (*shape, 3):
            raise InputError(
                f"rotation has shape {tuple(self.rotation.shape)} and position {shape}; expected "
                f"(F, {count}, 3, 3) and (F, {count}, 3), F of 1 or more"
            )
        if not bool(self.rotation.isfinite().all() & self.position.isfinite().all()):
            raise InputError("rotation or position holds what is no number; fill gaps first")
        turns = self.rotation.detach().double()
        off = float((turns @ turns.mT - torch.eye(3).to(turns)).abs().amax())
        if off > _SKEWED or bool((torch.linalg.det(turns) < 0).any()):
            raise InputError(
                f"rotation holds matrices that are none (rows off a right angle or unit length by "
                f"up to {off:.2g}, or a mirror image); expected rotations without a scale"
            )


def require_same_limbs(source: Actor, joints: JointMotion, rate: float = 30.0) -> None:
    """Refuse joints in another unit than their skeleton, and warn of other limbs and worlds.

    Args:
        source: whose joints they are.
        joints: in motion, (F,), metres.
        rate: frames a second.

    Raises:
        InputError: limbs are more than ten times as long as the source's, or less than a tenth.
    """
    rest = source.skeleton.rest_positions.detach().double().cpu()
    rest = rest[person_joints(source.skeleton)]
    start, end = ([JOINTS.index(limb[side]) for limb in LIMBS] for side in (0, 1))
    place, turn = (part.detach().double().cpu() for part in (joints.position, joints.rotation))
    shown, own = place[:, end] - place[:, start], rest[end] - rest[start]
    ratio = float((shown.norm(dim=-1) / own.norm(dim=-1)).median())
    if not 1 / _UNITS < ratio < _UNITS:
        raise InputError(
            f"joints: limbs are {ratio:.3g} times as long as the source's; expected metres, and "
            "joints of this source"
        )
    if not 1 / _ALIKE < ratio < _ALIKE:
        warnings.warn(
            f"joints: limbs are {ratio:.3g} times as long as the source's; expected joints of this "
            "source: the way of the hips is to its scale",
            stacklevel=4,
        )
    if _lies(place):
        warnings.warn(
            f"joints: the person lies in nearly all frames, along {_lengthwise(place)}; if they do "
            "not, the world is another: expected y up; turn it upright, and of a capture give the "
            "folder, not a file of it",
            stacklevel=4,
        )
    carried = (turn[:, start] @ own.unsqueeze(-1)).squeeze(-1)
    for line in moment_doubts(carried, shown, rate):
        warnings.warn(f"joints: {line}", stacklevel=4)


def _lies(place: Tensor) -> bool:
    """Whether the trunk (F, 16, 3) is along the ground, or upside down, in nearly all frames."""
    start, end = ([JOINTS.index(f"{s}_{n}") for s in "lr"] for n in ("hip", "shoulder"))
    foot = [JOINTS.index(f"{s}_ankle") for s in "lr"]
    up = torch.nn.functional.normalize(place[:, end].mean(1) - place[:, start].mean(1), dim=-1)
    legs = torch.nn.functional.normalize(place[:, start].mean(1) - place[:, foot].mean(1), dim=-1)
    trunk, leg = (float((part[:, 1] < _STEEP).double().mean()) > _NEARLY for part in (up, legs))
    # trunks bend where another axis is up; of who sits on the ground, they stand up from the legs
    bent = leg and float(up[:, 1].mean()) < _STEEP and float((up * legs).sum(-1).mean()) > _STEEP
    return len(up) >= _FEWEST and (trunk or bent)


def _lengthwise(place: Tensor) -> str:
    """The axis of the world that a body (F, 16, 3) is mostly along, from feet to shoulders."""
    start, end = ([JOINTS.index(f"{s}_{n}") for s in "lr"] for n in ("ankle", "shoulder"))
    body = (place[:, end].mean(1) - place[:, start].mean(1)).mean(0)
    along = int(body.abs().argmax())
    return ("-" if body[along] < 0 else "") + "xyz"[along]


def person_joints(skeleton: Skeleton) -> list[int]:
    """Rows of a skeleton's joints that are the sixteen of a person, in their order."""
    return list(skeleton.rig.roles) or list(range(len(JOINTS)))


def leg_length(actor: Actor) -> float:
    """Of thigh, shank and the height of the ankle, mean of both sides, metres."""
    skeleton = actor.skeleton
    at = dict(zip(JOINTS, skeleton.rest_positions[person_joints(skeleton)], strict=True))
    sole = sole_skeleton(actor).rest_landmarks[-SOLES:, 1].min()
    sides = [
        (at[f"{s}_knee"] - at[f"{s}_hip"]).norm()
        + (at[f"{s}_ankle"] - at[f"{s}_knee"]).norm()
        + (at[f"{s}_ankle"][1] - sole)
        for s in "lr"
    ]
    return float(sum(sides)) / len(sides)


def arm_length(skeleton: Skeleton) -> float:
    """Of upper arm and forearm, mean of both sides, metres."""
    at = dict(zip(JOINTS, skeleton.rest_positions[person_joints(skeleton)], strict=True))
    sides = [
        (at[f"{s}_elbow"] - at[f"{s}_shoulder"]).norm()
        + (at[f"{s}_wrist"] - at[f"{s}_elbow"]).norm()
        for s in "lr"
    ]
    return float(sum(sides)) / len(sides)


def neutral_turns(skeleton: Skeleton) -> Tensor:
    """Rotations of the joints from the rest pose to the anatomical neutral one, (16, 3, 3).

    The neutral pose stands along y and faces +z, also where the rest pose leans or faces elsewhere.
    """
    rig = skeleton.rig
    if rig.neutral is not None:
        return rig.neutral.to(skeleton.rest_positions)
    marks = zip(rig.landmarks, skeleton.rest_landmarks, strict=True)
    at = dict(marks) | dict(zip(rig.joints[: len(JOINTS)], skeleton.rest_positions, strict=False))
    upright = upright_turn(at)
    if not torch.equal(upright, torch.eye(3).to(upright)):
        # angles are measured from trunks as they rest: of a body that leans, limbs are not at rest
        standing = Skeleton(human_rig({name: upright @ place for name, place in at.items()}))
        skeleton = standing.to(skeleton.rest_positions)
    rest = skeleton.rest_motion()
    rotation: Tensor = skeleton(replace(rest, angles=torch.zeros_like(rest.angles))).rotation
    return rotation[0, person_joints(skeleton)] @ upright


def wanted_turns(source: Actor, joints: JointMotion, target: Skeleton) -> Tensor:
    """Rotations of the target's joints of a person from its rest pose, (F, 16, 3, 3).

    As far from its neutral pose as the source is from its own, with limbs in exactly the source's
    directions.
    """
    like = target.rest_positions
    rest = like[person_joints(target)]
    turned = joints.rotation.to(like) @ neutral_turns(source.skeleton).mT.to(like)
    wanted = turned @ neutral_turns(target)
    for start, end in LIMBS:
        a, b = JOINTS.index(start), JOINTS.index(end)
        aim = unit_vectors((joints.position[:, b] - joints.position[:, a]).to(like))
        along = unit_vectors(rest[b] - rest[a])
        wanted[:, a] = _least_turn(wanted[:, a] @ along, aim) @ wanted[:, a]
    return wanted


def _least_turn(one: Tensor, other: Tensor) -> Tensor:
    """The smallest rotations (F, 3, 3) that take unit vectors (F, 3) to others."""
    axis = torch.linalg.cross(one, other)
    sine, cosine = axis.norm(dim=-1), (one * other).sum(-1)
    angle = torch.atan2(sine, cosine)
    return rotvec_to_matrix(axis / sine.clamp(min=_SHORTEST)[:, None] * angle[:, None])


def carried_landmarks(skeleton: Skeleton, joints: JointMotion) -> Tensor:
    """Landmarks of a skeleton on joints that move, (F, L, 3), metres."""
    like = skeleton.rest_positions
    owner = torch.tensor(skeleton.rig.landmark_joints)
    local = skeleton.rest_landmarks - like[owner]
    turned: Tensor = (joints.rotation.to(like)[:, owner] @ local[..., None])[..., 0]
    return turned + joints.position.to(like)[:, owner]


def unit_vectors(vectors: Tensor) -> Tensor:
    """Vectors (..., 3) of length one; zero stays zero."""
    unit: Tensor = vectors / vectors.norm(dim=-1, keepdim=True).clamp(min=_SHORTEST)
    return unit
