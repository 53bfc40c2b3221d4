"""What is odd about a motion on another skeleton."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from torch import Tensor

from perfcap.actor.actor import Actor
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.retarget import mid_hip
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.motion_leaps import turn_doubts
from perfcap.pipeline.result_doubts import FASTEST, hip_speed

if TYPE_CHECKING:
    from perfcap.pipeline.retarget_scores import RetargetScores
    from perfcap.pipeline.retargeting import Retargeted

_FAR_OFF = 15.0  # degrees, that one in twenty limbs may be off
_NECKS = 5.0  # degrees more of trunks, whose necks are drawn elsewhere: up to 13 in recordings
_OFF_FLOOR = 0.5  # m
_LYING, _MOSTLY = 0.34, 0.9  # sine of a trunk's slope; share of frames
_OTHER_LEGS = 2.0  # times, that people who share a scale may differ from it by
_HASTE = 0.98  # of the speed that hinges of robots may have


def retarget_doubts(
    target: Actor,
    found: Retargeted,
    scores: RetargetScores,
    rate: float,
    numbers: Sequence[int],
    *,
    grounded: bool = True,
    mapping: str = "mapping",
) -> Iterator[str]:
    """What no person does, and what no person can have done on this figure.

    Args:
        target: who moves now.
        found: how, (F,).
        scores: what was kept of the source.
        rate: frames a second.
        numbers: of the F frames, as users count.
        grounded: whether the world's floor is to be at y = 0.
        mapping: what users call that of the source's bones.
    """
    robot = bool(target.skeleton.rig.roles)
    if scores.report()["limbs_degrees"]["q95"] > _FAR_OFF:
        yield (
            f"limbs are far from the source's in some frames; check its bones ({mapping}) and the "
            "order of its rotations"
            + (", and axes and limits of the robot's joints" if robot else "")
        )
    if not robot:
        yield from rest_doubts(scores)
    fastest = max(hip_speed(found.motion, rate).tolist(), default=0.0)
    if fastest > FASTEST:
        yield (
            f"the hips move at {fastest:.0f} m/s, faster than any runner; check the unit of the "
            "source's places, and whether it jumps"
        )
    yield from turn_doubts(found.motion.rotation, rate, numbers)
    joints = target.joints(found.motion)
    yield from (*(floor_doubts(joints) if grounded else ()), *lying_doubts(joints))
    speed = rate * found.motion.angles.diff(dim=0).abs().amax(1).rad2deg()
    fast = (speed > _HASTE * RetargetConfig().speed).nonzero().flatten().tolist()
    if robot and fast:
        yield (
            f"hinges turn at {float(speed.max()):.0f} degrees a second in {len(fast)} frames, "
            f"first in frame {numbers[fast[0] + 1]}: limits leave no short way between two poses, "
            "and limbs are off meanwhile"
        )


def scale_doubts(ratio: float, scale: float) -> Iterator[str]:
    """A scale of the way of the hips that is not that of the legs.

    Args:
        ratio: length of the target's legs by that of the source's, times.
        scale: metres of the target for a metre of the source.
    """
    if not 1 / _OTHER_LEGS <= scale / ratio <= _OTHER_LEGS:
        yield (
            f"scale is {scale:.3g}, and the target's legs are {ratio:.3g} times as long as the "
            "source's: feet that stand slide; expected about that, unless people who are to stay "
            "together share a scale"
        )


def rest_doubts(scores: RetargetScores) -> Iterator[str]:
    """What is odd about how a figure bears itself, as against the source."""
    aside, lean = float(scores.facing.median()), float(scores.trunk.median())
    if max(aside, lean - _NECKS) > _FAR_OFF:
        yield (
            f"hips and shoulders are {aside:.0f} degrees and the trunk is {lean:.0f} degrees off "
            "the source's in half of the frames; stand the character, or the source's skeleton, "
            "upright and facing ahead in its rest pose"
        )


def floor_doubts(joints: Tensor) -> Iterator[str]:
    """Joints (F, 16, 3) in a world with y up that are far from its floor at 0."""
    least = float(joints[..., 1].amin(-1).median())
    if abs(least) > _OFF_FLOOR:
        where = "above" if least > 0 else "below"
        yield (
            f"the person is {abs(least):.2g} m {where} the floor in half of the frames; unless "
            "they climb, check the unit of the source's places against that of its bones"
        )


def lying_doubts(joints: Tensor) -> Iterator[str]:
    """Joints (F, 16, 3) of somebody who lies in a world with y up."""
    trunk = joints[:, LANDMARKS.index("neck")] - mid_hip(joints)
    leaning = trunk[:, 1] < _LYING * trunk.norm(dim=-1)
    if leaning.double().mean() > _MOSTLY:
        yield (
            "the person lies, or stands on their head, in nearly all frames; check which axis is "
            "up in the source's motion"
        )
