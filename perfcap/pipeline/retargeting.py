"""Motion of one skeleton on another: a solve, not a copy of angles.

Every joint of the source turned in some way from the anatomical neutral pose, and so shall the
target's: rest poses do not matter. Limbs keep the source's directions, wrists reach as far from the
shoulders in lengths of the arm, and the place of the hips scales with the length of the legs. What
proportions and joint limits make impossible is weighed in one least-squares problem a frame, with
feet tied to where they stand, as in a capture.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.joint_angles import joint_angles
from perfcap.actor.motion import Motion
from perfcap.actor.sole_points import sole_skeleton
from perfcap.detect.joint_set import LANDMARKS
from perfcap.energy.prior import PosePrior
from perfcap.energy.trajectory import TrajectoryChange
from perfcap.errors import InputError
from perfcap.geometry.rotation import matrix_to_rotvec
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.floor import Floor, find_floor, lean_doubts
from perfcap.pipeline.joint_motion import (
    SOLES,
    JointMotion,
    carried_landmarks,
    leg_length,
    person_joints,
    require_same_limbs,
    wanted_turns,
)
from perfcap.pipeline.motion_order import order_doubts
from perfcap.pipeline.objective import angle_bounds, soft_edge
from perfcap.pipeline.place_units import place_doubts
from perfcap.pipeline.pose_paths import Pace, in_turn, paced
from perfcap.pipeline.retarget_doubts import retarget_doubts, scale_doubts
from perfcap.pipeline.retarget_rows import Rows
from perfcap.pipeline.retarget_scores import retarget_scores
from perfcap.pipeline.robot_feet import above_floor, grounded
from perfcap.pipeline.stances import contact_probability
from perfcap.pipeline.standing import Standing, stand_where
from perfcap.pipeline.track_motion import MotionBlender
from perfcap.rates import frame_rate, rate_doubts
from perfcap.solve import Bounds, LevenbergMarquardt, Objective, solve
from perfcap.solve.energy import Energy
from perfcap.temporal.window import partition

_UP = (0.0, 1.0, 0.0)
_WINDOW, _OVERLAP, _AT_ONCE = 50, 10, 4  # frames, frames, windows
_AT_REST = 2.0  # rad: a limb off rest by this is off its direction by less than 0.1 degrees


@dataclass(frozen=True)
class Retargeted:
    """A motion of another actor.

    Attributes:
        motion: of the target, (F,), within its limits, in a world with y up.
        floor: y = 0, that its feet stand on; None where there is none.
        contact: probability that the left and the right foot stand, (F, 2); None likewise.
        scale: metres of the target for a metre of the source.
        lowered: by which the motion was moved so that its floor is y = 0, metres; None likewise.
    """

    motion: Motion
    floor: Floor | None
    contact: Tensor | None
    scale: float
    lowered: float | None = None


@torch.no_grad()
def retarget(
    source: Actor,
    joints: JointMotion,
    target: Actor,
    rate: float,
    config: RetargetConfig | None = None,
    scale: float | None = None,
    *,
    whole: JointMotion | None = None,
    examined: bool = False,
) -> Retargeted:
    """The motion of a source on a target of another build and rest pose.

    Args:
        source: whose skeleton moved.
        joints: how, (F,), in a world with y up.
        target: who shall move so.
        rate: frames a second.
        config: what is to be kept how well.
        scale: of the way of the hips; the ratio of the legs if None. People who are to stay
            together need the same.
        whole: of which ``joints`` are a part: the floor is that on which feet stand in all of it.
        examined: whether the caller looks at what came of it; else what is odd is warned of, see
            ``retarget_doubts``.

    Raises:
        InputError: the rate, the scale or a setting is none, or joints are in another unit.
    """
    rate = frame_rate(rate)
    _require_arguments(source, joints, target)
    whole = joints if whole is None else whole
    _require_arguments(source, whole, target, "whole")
    points = carried_landmarks(source.skeleton, joints)[:, : len(LANDMARKS)]
    if scale is not None and not 0 < scale < math.inf:
        raise InputError(f"scale is {scale}, expected a number above 0")
    config = config or RetargetConfig()
    require_same_limbs(source, joints, rate)
    root = joints.position[:, JOINTS.index("pelvis")]
    legs = leg_length(source)
    doubts = *order_doubts(joints.position, rate), *place_doubts(points, rate, legs, root)
    ratio = leg_length(target) / legs
    scale = ratio if scale is None else scale
    for line in (*rate_doubts(rate), *doubts, *scale_doubts(ratio, scale)):
        warnings.warn(f"retarget: {line}", stacklevel=2)
    found = _carried(source, joints, whole, target, rate, config, scale)
    if not examined:
        scores = retarget_scores(source, joints, target, found, rate)
        came = target, found, scores, rate, range(found.motion.frames)
        for line in retarget_doubts(*came, grounded=config.contact.enabled):
            warnings.warn(f"retarget: {line}", stacklevel=2)
    return found


def _carried(
    source: Actor,
    joints: JointMotion,
    whole: JointMotion,
    target: Actor,
    rate: float,
    config: RetargetConfig,
    scale: float,
) -> Retargeted:
    """The motion, on the floor if there is one."""
    wanted = wanted_turns(source, joints, target.skeleton)
    begun = _placed(source, joints, target, wanted, scale)
    floor, sure = _contacts(source, joints, whole, rate)
    rows = Rows.of(source, joints, target, begun, config)
    first = _each(target, rows, begun, config)
    if target.skeleton.rig.roles:

        def solved(energies: dict[str, Energy[Motion]], state: Motion, reach: float) -> Motion:
            near = Bounds.on_frames(*_within(target, state, reach))
            return _solved(target, energies | _rest(target), state, config, near)

        pace = Pace(math.radians(config.still), math.radians(config.speed) / rate)
        first = in_turn(rows, begun, first, pace, solved)
    if floor is None or config.contact.support > floor.support or not config.contact.enabled:
        if target.skeleton.rig.roles and config.contact.enabled:
            first = grounded(target, first)
        return Retargeted(first, None, None, scale)
    ground = replace(floor, height=scale * floor.height)
    skeleton = sole_skeleton(target)
    soles = skeleton(first).landmarks[:, -SOLES:]
    known = torch.eye(3).to(soles).expand(len(soles), 3, 3) / config.root**2
    standing = stand_where(skeleton, soles, ground, sure, rate, config.contact, known)
    last = _standing(target, rows, first, standing, rate, config)
    level = replace(last, translation=last.translation - ground.height * ground.normal)
    if target.skeleton.rig.roles:
        level = paced(level, math.radians(config.speed) / rate)
        level = above_floor(target, level, rate)
    floor = replace(ground, height=ground.height * 0)
    return Retargeted(level, floor, standing.feet, scale, float(ground.height))


def _require_arguments(
    source: object, joints: object, target: object, called: str = "joints"
) -> None:
    given = ("source", source, Actor), (called, joints, JointMotion), ("target", target, Actor)
    for name, value, kind in given:
        if not isinstance(value, kind):
            raise InputError(
                f"{name} is a {type(value).__name__}, expected {'an' if kind is Actor else 'a'} "
                f"{kind.__name__}: retarget(source, joints, target, rate)"
            )


def _placed(
    source: Actor, joints: JointMotion, target: Actor, wanted: Tensor, scale: float
) -> Motion:
    """The target with its hips where the source's are, to scale, and its joints turned so.

    Of a robot only its root is turned: its hinges are not those of a person.
    """
    skeleton = target.skeleton
    rows = person_joints(skeleton)
    hips = [JOINTS.index(f"{side}_hip") for side in "lr"]
    middle = scale * joints.position[:, hips].mean(1).to(wanted)
    rest = skeleton.rest_positions[[rows[hip] for hip in hips]]
    turn = wanted[:, rows.index(0) if 0 in rows else 0]
    place = middle - turn @ (rest.mean(0) - skeleton.rest_positions[0])
    if skeleton.rig.roles:
        still = skeleton.rest_angles.clamp(skeleton.lower, skeleton.upper)
        angles = still.to(wanted).expand(len(wanted), -1).clone()
    else:
        angles = joint_angles(skeleton, wanted)
    return Motion(place, matrix_to_rotvec(turn), angles)


def _contacts(
    source: Actor, joints: JointMotion, whole: JointMotion, rate: float
) -> tuple[Floor, Tensor]:
    """The source's floor, and the probability that each point under its feet stands, (F, N)."""
    skeleton = sole_skeleton(source)
    points = carried_landmarks(skeleton, whole)
    soles, landmarks = points[:, -SOLES:], points[:, :-SOLES]
    floor = find_floor(landmarks, soles, rate, normal=points.new_tensor(_UP))
    for line in lean_doubts(landmarks, soles, rate, floor):
        warnings.warn(f"retarget: {line}", stacklevel=4)
    own = soles if whole is joints else carried_landmarks(skeleton, joints)[:, -SOLES:]
    return floor, contact_probability(own, floor, rate)


def _each(target: Actor, rows: Rows, begun: Motion, config: RetargetConfig) -> Motion:
    """The pose of every frame on its own, many at once."""
    parts = []
    for start in range(0, begun.frames, config.frames):
        index = torch.arange(start, min(start + config.frames, begun.frames))[:, None]  # N 1
        state = begun.map(lambda each, index=index: each[index])
        parts.append(_solved(target, {"pose": rows.energy(index)} | _rest(target), state, config))
    return Motion.cat([part.map(lambda each: each[:, 0]) for part in parts])


def _rest(target: Actor) -> dict[str, Energy[Motion]]:
    """What keeps hinges of a robot at rest that move nothing a person's limbs show.

    Without it a solver that knows no units moves them by whole ranges for rounding errors.
    """
    skeleton = target.skeleton
    if not skeleton.rig.roles:
        return {}
    rest = skeleton.rest_angles.clamp(skeleton.lower, skeleton.upper)
    return {"rest": PosePrior(rest, _AT_REST)}


def _standing(
    target: Actor,
    rows: Rows,
    given: Motion,
    standing: Standing,
    rate: float,
    config: RetargetConfig,
) -> Motion:
    """The motion with feet that stand, changed from a given one by what is slow."""
    windows = partition(given.frames, _WINDOW, _OVERLAP)
    keep = soft_edge(config.edge, len(windows[0]), rate)
    place, turn, angle = config.change
    blender = MotionBlender()
    for start in range(0, len(windows), _AT_ONCE):
        group = windows[start : start + _AT_ONCE]
        index = torch.stack([torch.arange(w.start, w.stop) for w in group])  # N W
        before = given.map(lambda each, index=index: each[index])
        change = TrajectoryChange(
            before,
            keep,
            translation=1 / place,
            rotation=1 / math.radians(turn),
            angles=1 / math.radians(angle),
        )
        energies = {"pose": rows.energy(index), "change": change} | _rest(target)
        tied = replace(config.contact, deviation=config.feet, depth=config.depth)
        energies |= standing.energies(index, tied)
        shift = standing.shift[index]
        moved = replace(before, translation=before.translation + shift)
        solved = _solved(target, energies, moved, config)
        for row, window in enumerate(group):
            blender.push(window, solved.map(lambda each, row=row: each[row]))
    return blender.finish(target.skeleton)


def _within(target: Actor, given: Motion, reach: float) -> tuple[Tensor, Tensor]:
    """Limits (*b, F, 6 + A) of angles that change by at most ``reach`` radians."""
    lower, upper = target.skeleton.bounds
    angles = given.angles.clamp(target.skeleton.lower, target.skeleton.upper)
    near = torch.nn.functional.pad(angles, (6, 0)).to(lower)
    far = torch.full_like(lower, reach)
    far[:6] = math.inf  # the root is free
    return torch.maximum(lower, near - far), torch.minimum(upper, near + far)


def _solved(
    target: Actor,
    energies: dict[str, Energy[Motion]],
    begun: Motion,
    config: RetargetConfig,
    bounds: Bounds | None = None,
) -> Motion:
    method = LevenbergMarquardt(config.steps, 1e-4, 1e-2)
    objective = Objective(energies).to(begun.angles.device)
    return solve(objective, begun, method, bounds or angle_bounds(target)).state
