"""A rest pose for a BVH file whose offsets are no pose of a person: a frame in which it stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.bone_map import map_bones
from perfcap.io.actor_check import CROUCHED, LEANING, RAISED, SEATED
from perfcap.io.bvh_read import BvhMotion, joint_positions
from perfcap.io.bvh_rig import stick_figure, with_feet

Floats = NDArray[np.float64]

_LOOKED_AT = 2000  # frames of a long file, evenly spread: a person stands for longer than a few
_REFUSED = 1000.0  # times an angle beyond what the import takes: more than all leans together
_LEVEL = np.pi / 2  # of an arm, from straight down
_ASIDE = 0.25  # weight: arms come right from most poses, feet, trunk and head keep the frame's
_LOW = 25  # per cent of the frames, in which a foot is lowest: it stands in most of them


@dataclass(frozen=True, eq=False)
class StandingPose:
    """A frame as the rest pose, turned about y such that the person faces +z.

    Attributes:
        frame: its number in the file.
        motion: the frame alone; its ends are in the axes of the places.
        places: of the joints, (J, 3), in the file's unit.
        turns: of the joints' own axes, (J, 3, 3).
    """

    frame: int
    motion: BvhMotion
    places: Floats
    turns: Floats


def standing_pose(motion: BvhMotion, rest: Floats, given: Mapping[str, str]) -> StandingPose:
    """The frame in which the person is most upright, on its feet, with arms that hang or are aside.

    Args:
        motion: the whole file, in any unit, y up.
        rest: places of its joints by its offsets, (J, 3), in its unit.
        given: names of bones by joint, which are taken as they are.

    Raises:
        InputError: a joint has no bone.
    """
    count = len(motion.rotations)
    looked = np.unique(np.linspace(0, count - 1, min(count, _LOOKED_AT)).round().astype(np.int64))
    part = part_of(motion, looked)
    every = joint_positions(part)
    # sides do not matter here: these offsets may tell the wrong ones
    joints = map_bones(stick_figure(motion, rest, "figure"), given).joints
    at = {name: every[:, bone] for name, bone in joints.items()}
    tips = {name: _tip(part, every, joints[name]) for name in ("head", "l_ankle", "r_ankle")}
    best = int((_lean(at) + _feet_and_head(at, tips)).argmin())
    one = part_of(motion, looked[best : best + 1])
    turns, places = world_turns(one)[0], every[best]
    posed = _with_turned_ends(one, turns)
    # the sides that the import will find in that frame, else it turns the world around
    figure = stick_figure(with_feet(posed, places), places, "figure")
    chosen = {name: places[bone] for name, bone in map_bones(figure, given).joints.items()}
    left = sum(chosen[f"l_{end}"] - chosen[f"r_{end}"] for end in ("hip", "shoulder"))
    yaw = np.arctan2(left[2], left[0])  # from the left hand's +x
    turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    turns = turn @ turns
    return StandingPose(int(looked[best]), _with_turned_ends(one, turns), places @ turn.T, turns)


def part_of(motion: BvhMotion, numbers: NDArray[np.int64]) -> BvhMotion:
    """Some frames of a motion.

    Args:
        motion: of F frames.
        numbers: of the frames to take, from zero, (N,).
    """
    rotations, positions = motion.rotations[numbers], motion.positions[numbers]
    return replace(motion, rotations=rotations, positions=positions)


def world_turns(motion: BvhMotion) -> Floats:
    """Rotations of the joints in the world, (F, J, 3, 3)."""
    turns = motion.rotations.copy()
    for joint, parent in enumerate(motion.parents.tolist()):
        if parent >= 0:
            turns[:, joint] = turns[:, parent] @ turns[:, joint]
    return turns


def _with_turned_ends(motion: BvhMotion, turns: Floats) -> BvhMotion:
    """Ends of limbs where joints have turned, (J, 3, 3): feet point elsewhere than by offsets."""
    if motion.ends is None:
        return motion
    return replace(motion, ends=(turns @ motion.ends[..., None])[..., 0])


def _lean(at: Mapping[str, Floats]) -> Floats:
    """How far frames are from a rest pose, (F,), of places of joints (F, 3): radians."""
    up = np.array([0.0, 1.0, 0.0])
    trunk = at["neck"] - at["pelvis"]
    hips, shoulders = (at[f"l_{end}"] - at[f"r_{end}"] for end in ("hip", "shoulder"))
    ahead = np.cross(hips + shoulders, up)
    lean = _angle(trunk, up)
    beyond = _excess(lean, LEANING)
    # their twist about the trunk
    lean = lean + _angle(np.cross(trunk, hips), np.cross(trunk, shoulders))
    for side in "lr":
        thigh, shank, arm = (
            at[f"{side}_{end}"] - at[f"{side}_{start}"]
            for start, end in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"))
        )
        bent, lifted = _angle(thigh, -up), _angle(arm, -up)
        lean = lean + bent + _angle(shank, -up)
        # nothing for arms that hang, or are held as in a T or an A
        lean = lean + _ASIDE * np.abs(_LEVEL - _angle(arm, ahead)) + (lifted - _LEVEL).clip(0)
        beyond = beyond + _excess(bent, SEATED) + _excess(lifted, RAISED)
        beyond = beyond + _excess(_angle(shank, thigh), CROUCHED)
    return lean + _REFUSED * beyond


def _feet_and_head(at: Mapping[str, Floats], tips: Mapping[str, Floats | None]) -> Floats:
    """How far feet and head are from those of who stands, (F,): about radians.

    Args:
        at: places of joints, (F, 3).
        tips: places of what ends head and feet, (F, 3); None where that is not known.
    """
    top = tips["head"]
    odd = _angle((at["head"] if top is None else top) - at["neck"], np.array([0.0, 1.0, 0.0]))
    for side in "lr":
        ankle, toe = at[f"{side}_ankle"], tips[f"{side}_ankle"]
        height = ankle[:, 1]
        low = height <= np.percentile(height, _LOW)
        shank = np.median(np.linalg.norm(ankle - at[f"{side}_knee"], axis=-1))
        # in lengths of the shank: nearly the angle by which the leg would have to bend
        odd = odd + (height - np.median(height[low])).clip(0) / max(float(shank), 1e-12)
        if toe is not None:
            foot = toe - ankle
            length = np.maximum(np.linalg.norm(foot, axis=-1), 1e-12)
            pitch = np.arcsin((foot[:, 1] / length).clip(-1, 1))
            # feet of skeletons begin at any height above the sole
            odd = odd + np.abs(pitch - np.median(pitch[low]))
    return odd


def _tip(motion: BvhMotion, every: Floats, joint: int) -> Floats | None:
    """Places of what a joint moves, its end or the joint below that is furthest off, (F, 3).

    Args:
        motion: of F frames.
        every: places of its joints, (F, J, 3).
        joint: number of the joint.
    """
    below = np.flatnonzero(motion.parents == joint)
    if len(below):
        furthest = np.linalg.norm(motion.offsets[below], axis=-1).argmax()
        return np.asarray(every[:, below[furthest]])
    if motion.ends is None or not np.isfinite(motion.ends[joint]).all():
        return None
    return np.asarray(every[:, joint] + world_turns(motion)[:, joint] @ motion.ends[joint])


def _excess(angle: Floats, degrees: float) -> Floats:
    """What angles in radians have beyond what the import takes."""
    found: Floats = (angle - np.radians(degrees)).clip(0)
    return found


def _angle(one: Floats, other: Floats) -> Floats:
    """Between vectors (F, 3), radians; a right angle where one has no length."""
    sizes = np.linalg.norm(one, axis=-1) * np.linalg.norm(other, axis=-1)
    found: Floats = np.arccos(((one * other).sum(-1) / np.maximum(sizes, 1e-12)).clip(-1, 1))
    return found
