"""The human skeleton: 16 joints, 33 degrees of freedom a frame (Xu et al. 2018, Sec. 4).

Six degrees move the root; 27 named angles turn the joints. Every angle is measured from the
anatomical neutral pose: standing upright, arms hanging with palms forward, feet pointing ahead.
The rest pose of an actor (T-pose, A-pose, ...) therefore has angles of its own, computed here.

Shoulder angles are unusual on purpose. Three hinges always have a direction in which the first
and the last axis coincide. With flexion first it is the T-pose, with abduction first an arm
pointing straight ahead: both common. Here the first hinge lifts the arm in the scapular plane, 40
degrees in front of the frontal plane, so the singular directions point backwards-outwards and
across the chest, at the ends of the range of motion, and trajectories stay smooth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor

from perfcap.actor.rig import Clavicle, Hinge, Rig
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError

SCAPULAR_PLANE = math.radians(40)  # Norkin and White 2016: 30 to 45 degrees


class Limit(NamedTuple):
    """Lower and upper limit of an angle in degrees, and where they come from."""

    lower: float
    upper: float
    source: str


_AAOS = "AAOS, Joint Motion: Method of Measuring and Recording, 1965"
_NORKIN = "Norkin and White, Measurement of Joint Motion, 5th ed. 2016, App. A"
_PANJABI = "White and Panjabi, Clinical Biomechanics of the Spine, 2nd ed. 1990"
_KURZ = "Kurz, Stretching Scientifically, 4th ed. 2003, table of normal ranges"
_RUSSELL = "Russell et al., Extreme Ankle Range of Motion of Ballet Dancers, Foot Ankle Spec. 2010"
_KAPANDJI = "Kapandji, The Physiology of the Joints, vol. 2, 6th ed. 2010"
_KAPANDJI_3 = "Kapandji, The Physiology of the Joints, vol. 3, 2nd ed. 1974"
_TAINAKA = (
    "Tainaka et al. 2014, as tabled in J. Athl. Train. 53(6), 2018, Table 1: "
    "mean and two deviations of 123 active people"
)
_BENNELL = (
    "Bennell et al., Br. J. Sports Med. 2001, Table 3: "
    "mean and two deviations of dancers of 8 to 11 years in a lunge"
)
_FEIPEL = "Feipel et al., Med. Probl. Perform. Art. 2004"

# Positive is named by the angle. Limits are wider than what is usual: large published values are
# taken, of dancers and athletes too, because a limit that is too narrow bends the rest of the body,
# and because one hinge stands for several joints of a real one. Three of them are readings of ours:
# the nod may go as far as both joints together in either direction, a hip has half of what dancers
# have between the thighs, and deviations are doubled. Kapandji's spine, hip flexion and foot are
# quoted from memory and have yet to be compared with the book.
CENTRE_LIMITS = {
    "spine_flexion": Limit(-60, 105, f"{_KAPANDJI_3}: thoracolumbar flexion 105, extension 60"),
    "spine_lateral": Limit(-35, 35, f"{_AAOS}: 35 each side; positive to the left"),
    "spine_axial": Limit(-45, 45, f"{_AAOS}: 45 each side; positive to the left"),
    "neck_flexion": Limit(-55, 70, f"{_KURZ}: flexion 70, extension 55"),
    "neck_lateral": Limit(-45, 45, f"{_AAOS}: 45 each side; positive to the left"),
    "neck_axial": Limit(-70, 70, f"{_KURZ}: 70 each side; positive to the left"),
    "head_nod": Limit(-45, 45, f"{_PANJABI}: flexion-extension of C0-C1 25, of C1-C2 20"),
}
SIDE_LIMITS = {
    "shoulder_elevation": Limit(-60, 180, f"{_AAOS}: flexion, abduction 180; extension 60"),
    "shoulder_horizontal": Limit(
        -85, 95, f"{_NORKIN}: horizontal adduction 135, abduction 45, from the scapular plane"
    ),
    "shoulder_rotation": Limit(-108, 90, f"{_NORKIN}: medial 90, lateral 108"),
    "elbow_flexion": Limit(0, 150, f"{_AAOS}: 0 to 150"),
    "hip_flexion": Limit(-30, 145, f"{_AAOS}: extension 30; {_KAPANDJI}: passive flexion 145"),
    "hip_abduction": Limit(-30, 60, f"{_AAOS}: adduction 30; {_FEIPEL}: half of 120"),
    "hip_rotation": Limit(-70, 65, f"{_TAINAKA}: external 56 + 14, internal 50 + 14"),
    "knee_flexion": Limit(0, 160, f"{_KAPANDJI}: 160 passive"),
    "ankle_dorsiflexion": Limit(-89, 46, f"{_RUSSELL}: plantar 89; {_BENNELL}: dorsal 34 + 12"),
    "ankle_inversion": Limit(-30, 52, f"{_KAPANDJI}: supination 52, pronation 30"),
}

# What healthy adults do, where limits are wider.
USUAL = {
    "spine_flexion": Limit(-30, 80, f"{_AAOS}: thoracolumbar flexion 80; {_KURZ}: extension 30"),
    "head_nod": Limit(-25, 25, f"{_PANJABI}: C0-C1, 25 of flexion-extension"),
    "hip_flexion": Limit(-30, 130, f"{_AAOS}: extension 30; {_KURZ}: flexion 130"),
    "hip_abduction": Limit(-30, 50, f"{_AAOS}: adduction 30; {_KURZ}: abduction 50"),
    "hip_rotation": Limit(-45, 45, f"{_AAOS}: 45 each way"),
    "ankle_dorsiflexion": Limit(-89, 30, f"{_RUSSELL}: plantar 89, dorsal 30"),
    "ankle_inversion": Limit(-25, 35, f"{_AAOS}: inversion 35; {_KAPANDJI}: eversion 25"),
}


def usual_ranges(rig: Rig) -> tuple[Tensor, Tensor]:
    """Lower and upper ends of what is usual, (A,) each, radians; limits where they are narrower."""
    lower, upper = [], []
    for hinge in rig.hinges:
        usual = USUAL.get(hinge.name.removeprefix("l_").removeprefix("r_"))
        low, high = (hinge.lower, hinge.upper) if usual is None else map(math.radians, usual[:2])
        lower.append(max(hinge.lower, min(low, hinge.rest)))
        upper.append(min(hinge.upper, max(high, hinge.rest)))
    return torch.tensor(lower, dtype=torch.float64), torch.tensor(upper, dtype=torch.float64)


PARENTS = {
    "pelvis": None,
    "spine": "pelvis",
    "neck": "spine",
    "head": "neck",
    **{f"{s}_shoulder": "spine" for s in "lr"},
    **{f"{s}_elbow": f"{s}_shoulder" for s in "lr"},
    **{f"{s}_wrist": f"{s}_elbow" for s in "lr"},
    **{f"{s}_hip": "pelvis" for s in "lr"},
    **{f"{s}_knee": f"{s}_hip" for s in "lr"},
    **{f"{s}_ankle": f"{s}_knee" for s in "lr"},
}
JOINTS = tuple(PARENTS)
CLAVICLES = ("l_clavicle", "r_clavicle")
"""Joints without angles of their own that an actor may have behind the sixteen."""
# Degrees that a clavicle rises while the arm goes from hanging to pointing up: the middle of the 11
# to 15 of Ludewig et al. 2004, Three-Dimensional Clavicular Motion during Arm Elevation, J. Orthop.
# Sports Phys. Ther. 34(3). It retracts by 15 to 29 as well; that is left out, because the shoulder
# joints of experiments/shoulders.py rise by 30 mm and move back by 3. Little of it comes before the
# arm is up by 30 degrees and most overhead, as (sin E/2)^4 grows: the shoulder blade has 2.5 % of
# the first 30 degrees of elevation, 21 and 38 % of the next two, 53 % of those from 90 to 120
# (Scibek and Carcia 2012, World J. Orthop. 3(6)).
CLAVICLE_RANGE = 13.0
# joints that coincide with a landmark, and the two ends that hang on another joint
_LANDMARK_JOINT = {"head_top": "head", "r_toe": "r_ankle", "l_toe": "l_ankle"}
# bones that share a length factor; left and right of a person are equal
_GROUPS = {
    "spine": "trunk",
    "neck": "trunk",
    "head": "head",
    "head_top": "head",
    "clavicle": "shoulders",
    "shoulder": "shoulders",
    "elbow": "upper_arm",
    "wrist": "forearm",
    "hip": "hips",
    "knee": "thigh",
    "ankle": "shank",
    "toe": "foot",
}
# The foot turns in about an oblique axis that rises forwards and points inwards (Inman 1976, The
# Joints of the Ankle): inversion comes with toes turned in, which is what joints can show.
_SUBTALAR_RISE, _SUBTALAR_TURN = math.radians(42), math.radians(23)
# A bend this small does not tell the axis of a knee or elbow: the anatomical one is used.
_STRAIGHT = math.radians(4)
# Less bend tells it where it lies near the anatomical one alone: of a forearm that droops a little,
# or a knee that lies inside of the leg, the bend is to the side, which no hinge does.
_SLIGHT, _NEAR = math.radians(20), math.cos(math.radians(25))


def human_rig(positions: Mapping[str, Tensor]) -> Rig:
    """Build the 33-degree skeleton of a person from rest positions.

    Args:
        positions: rest position (3,), metres, of the 16 joints of ``JOINTS`` and of the landmarks
            head_top, l_toe and r_toe; the person faces +z with y up, left is +x. Where clavicles
            begin, if there are any: then shoulders rise with the arms.

    Raises:
        InputError: a position is missing or the body is degenerate.
    """
    needed = (*JOINTS, *_LANDMARK_JOINT)
    missing = [name for name in needed if name not in positions]
    if missing:
        raise InputError(
            f"actor has no bone named {', '.join(missing)}; expected all of {', '.join(needed)}"
        )
    at = {name: torch.as_tensor(place).double() for name, place in positions.items()}
    names = (*JOINTS, *(name for name in CLAVICLES if name in at))
    joints = torch.stack([at[name] for name in names])
    own = [PARENTS.get(name, "spine") for name in names]
    parents = tuple(-1 if p is None else JOINTS.index(p) for p in own)
    landmark_joints = tuple(JOINTS.index(_LANDMARK_JOINT.get(n, n)) for n in LANDMARKS)
    landmarks = torch.stack([torch.as_tensor(positions[name]).double() for name in LANDMARKS])
    return Rig(
        joints=names,
        parents=parents,
        positions=joints,
        hinges=_hinges(at),
        landmarks=LANDMARKS,
        landmark_joints=landmark_joints,
        landmark_positions=landmarks,
        bone_groups=tuple(_group(name) for name in (*names, *LANDMARKS)),
        clavicles=tuple(_clavicle(name, at) for name in names[len(JOINTS) :]),
    )


def _clavicle(name: str, at: Mapping[str, Tensor]) -> Clavicle:
    """A clavicle that rises about the horizontal axis square to it."""
    shoulder = f"{name[0]}_shoulder"
    up = _body_axes(at)[:, 1]
    axis = torch.linalg.cross(at[shoulder] - at[name], up)
    if axis.norm() < 1e-6:
        raise InputError(f"actor has its {name} straight below its shoulder; check its rest pose")
    x, y, z = (float(value) for value in axis / axis.norm())
    lifts = (f"{shoulder}_elevation", f"{shoulder}_horizontal")
    return Clavicle(name, shoulder, (x, y, z), math.radians(CLAVICLE_RANGE), lifts)


def _group(name: str) -> str:
    bare = name.split("_", 1)[1] if name[:2] in ("l_", "r_") else name
    return _GROUPS.get(bare, "root")


def _hinges(at: Mapping[str, Tensor]) -> tuple[Hinge, ...]:
    body = _body_axes(at)
    left, up, ahead = body.unbind(-1)
    hinges = []
    for joint in ("spine", "neck"):
        for kind, axis in (("flexion", left), ("lateral", -ahead), ("axial", up)):
            hinges.append(_hinge(f"{joint}_{kind}", joint, axis, CENTRE_LIMITS))
    hinges.append(_hinge("head_nod", "head", left, CENTRE_LIMITS))
    for side in "lr":
        hinges += _arm(side, at, body)
    for side in "lr":
        hinges += _leg(side, at, body)
    return tuple(hinges)


def _body_axes(at: Mapping[str, Tensor]) -> Tensor:
    """Left, up and ahead of the trunk as columns of a rotation matrix (3, 3)."""
    up = at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"])
    across = at["l_hip"] - at["r_hip"] + at["l_shoulder"] - at["r_shoulder"]
    ahead = torch.linalg.cross(across, up)
    if ahead.norm() < 1e-6:
        raise InputError("actor has hips, shoulders and neck on one line; check its rest pose")
    # a person stands upright in the rest pose: small leans of the trunk are part of the pose
    upright = torch.tensor([0.0, 1.0, 0.0]).to(up)
    up = upright if up @ upright > 0.9 * up.norm() else up / up.norm()
    ahead = torch.linalg.cross(across, up)
    ahead = ahead / ahead.norm()
    return torch.stack((torch.linalg.cross(up, ahead), up, ahead), -1)


def _arm(side: str, at: Mapping[str, Tensor], body: Tensor) -> list[Hinge]:
    left, up, ahead = body.unbind(-1)
    sign = 1.0 if side == "l" else -1.0
    plane = math.cos(SCAPULAR_PLANE) * sign * left + math.sin(SCAPULAR_PLANE) * ahead
    axes = torch.stack((torch.linalg.cross(plane, up), -sign * plane, -sign * up))
    upper = at[f"{side}_elbow"] - at[f"{side}_shoulder"]
    lower = at[f"{side}_wrist"] - at[f"{side}_elbow"]
    # hanging arms bend forwards about -left; a T-pose with palms down bends forwards as well
    axis, bend = _bend(upper, lower, torch.linalg.cross(upper, ahead))
    frame = _frame(upper, axis)
    rest = _three_angles(frame @ _frame(-up, -left).mT, axes)
    names = [f"shoulder_{k}" for k in ("elevation", "horizontal", "rotation")]
    hinges = [
        _hinge(name, "shoulder", a, SIDE_LIMITS, side, r)
        for name, a, r in zip(names, axes, rest, strict=True)
    ]
    return [*hinges, _hinge("elbow_flexion", "elbow", axis, SIDE_LIMITS, side, bend)]


def _leg(side: str, at: Mapping[str, Tensor], body: Tensor) -> list[Hinge]:
    left, up, ahead = body.unbind(-1)
    sign = 1.0 if side == "l" else -1.0
    thigh = at[f"{side}_knee"] - at[f"{side}_hip"]
    shank = at[f"{side}_ankle"] - at[f"{side}_knee"]
    toe = at[f"{side}_toe"] - at[f"{side}_ankle"]
    axis, bend = _bend(thigh, shank, left)
    axes = torch.stack((-left, sign * ahead, -sign * up))
    rest = _three_angles(_frame(thigh, axis) @ _frame(-up, left).mT, axes)
    names = [f"hip_{k}" for k in ("flexion", "abduction", "rotation")]
    hinges = [
        _hinge(name, "hip", a, SIDE_LIMITS, side, r)
        for name, a, r in zip(names, axes, rest, strict=True)
    ]
    hinges.append(_hinge("knee_flexion", "knee", axis, SIDE_LIMITS, side, bend))
    # the foot is neutral when the ground it stands on is square to the shank
    forward = toe - (toe @ up) * up
    if forward.norm() < 1e-6:
        raise InputError(
            f"{side}_toe lies at or straight below {side}_ankle; expected the toes, ahead of it"
        )
    forward = forward / forward.norm()
    lateral = torch.linalg.cross(up, forward)
    lean = torch.atan2(-(shank @ forward), -(shank @ up))
    hinges.append(_hinge("ankle_dorsiflexion", "ankle", -lateral, SIDE_LIMITS, side, float(lean)))
    inward = math.cos(_SUBTALAR_RISE) * math.sin(_SUBTALAR_TURN) * lateral
    ahead = math.cos(_SUBTALAR_RISE) * math.cos(_SUBTALAR_TURN) * forward
    subtalar = inward - sign * (ahead + math.sin(_SUBTALAR_RISE) * up)
    hinges.append(_hinge("ankle_inversion", "ankle", subtalar, SIDE_LIMITS, side))
    return hinges


def _hinge(
    name: str,
    joint: str,
    axis: Tensor,
    limits: Mapping[str, Limit],
    side: str = "",
    rest: float | Tensor = 0.0,
) -> Hinge:
    prefix = f"{side}_" if side else ""
    lower, upper = (math.radians(v) for v in limits[name][:2])
    rest = float(rest)
    # a rest pose outside the anatomical range (a scan's hyperextended elbow) must stay reachable
    return Hinge(
        prefix + name,
        prefix + joint,
        (float(axis[0]), float(axis[1]), float(axis[2])),
        min(lower, rest),
        max(upper, rest),
        rest,
    )


def _bend(upper: Tensor, lower: Tensor, expected: Tensor) -> tuple[Tensor, float]:
    """Flexion axis of a knee or elbow from its two bones, and the flexion of the rest pose."""
    normal = torch.linalg.cross(upper, lower)
    sine = normal.norm() / (upper.norm() * lower.norm())
    square = expected - (expected @ upper) / (upper @ upper) * upper
    square = square / square.norm()
    near = _NEAR if sine < math.sin(_SLIGHT) else 0.5
    if sine < math.sin(_STRAIGHT) or normal @ square < near * normal.norm():
        # straight (or bent to the side, or the wrong way): flexion about the anatomical axis
        axis = square
    else:
        axis = normal / normal.norm()
    along = torch.linalg.cross(axis, upper / upper.norm())
    bend = torch.atan2(lower @ along, lower @ (upper / upper.norm()))
    return axis, float(bend)


def _frame(bone: Tensor, hinge: Tensor) -> Tensor:
    """Rotation matrix whose columns are the bone, its hinge (made square to it) and their cross."""
    first = bone / bone.norm()
    second = hinge - (hinge @ first) * first
    second = second / second.norm()
    return torch.stack((first, second, torch.linalg.cross(first, second)), -1)


def _three_angles(rotation: Tensor, axes: Tensor) -> tuple[float, float, float]:
    """Angles of three mutually square hinges whose product is ``rotation``."""
    basis = axes.mT if torch.linalg.det(axes) > 0 else axes.mT * axes.new_tensor([1.0, 1.0, -1.0])
    handed = 1.0 if torch.linalg.det(axes) > 0 else -1.0
    r = basis.mT @ rotation @ basis  # now Rx(a) Ry(b) Rz(c)
    second = math.asin(max(-1.0, min(1.0, float(r[0, 2]))))
    first = math.atan2(-float(r[1, 2]), float(r[2, 2]))
    third = math.atan2(-float(r[0, 1]), float(r[0, 0]))
    return first, second, handed * third
