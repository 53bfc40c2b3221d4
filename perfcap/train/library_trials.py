"""Whether recorded motion is right only when a part of it is read otherwise than as it says.

Feet that stand do not slide, arms hang, and trunks are above the feet that carry them. No such
rule holds for all motion: skaters slide, and on a treadmill everybody does. But where motion
breaks one and the same numbers in another order, sign or unit keep it, they were written so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.doctor.leaps import LEAP, LEAPING, leaping

Array = NDArray[np.float64]
Read = Callable[[Array], Array]
Pose = Callable[[Array, Array, Array], Array]
"""Angles (F, J, 3) degrees, root (F, 3) and offsets (J, 3) metres to landmarks (F, 16, 3)."""

_PAIRS = 2000  # of successive frames, of a library
_FEWEST = 300  # of them: fewer say nothing
_RATE = 60.0  # Hz
_HALF = 0.6  # times what it is, that another reading makes of it
_SLIDING = 0.5  # m/s, of which people are warned; of the six of the CMU library it is 0.21
_BENT, _HANGS = 0.35, -0.5  # sine of an elbow, and cosine of an upper arm to the way up the trunk
_WARNED = 600  # frames: a single short clip may slide


@dataclass(frozen=True)
class _Rule:
    """What motion of people keeps.

    Attributes:
        measure: of landmarks of frames and of the frames after them, (F, 2, 16, 3), one a frame.
        odd: median above which motion is tried otherwise, and below which other motion is right.
        fine: the same for motion that is tried.
        what: is odd, with a place for the median.
    """

    measure: Callable[[Array], Array]
    odd: float
    fine: float
    what: str


def _at(points: Array, *names: str) -> Array:
    """Mean of landmarks (..., 16, 3)."""
    found: Array = points[..., [LANDMARKS.index(name) for name in names], :].mean(-2)
    return found


def slide(points: Array) -> Array:
    """Speed of the lowest foot of frames and those after them (F, 2, 16, 3), metres a second."""
    names = ("l_ankle", "l_toe", "r_ankle", "r_toe")
    feet = points[:, :, [LANDMARKS.index(name) for name in names]]
    lowest = feet[:, 0, :, 1].argmin(1)
    moved = feet[np.arange(len(feet)), :, lowest]
    speed: Array = _RATE * np.linalg.norm(moved[:, 1] - moved[:, 0], axis=-1)
    return speed


def _raised(points: Array) -> Array:
    """1 less the cosine of upper arms to the way down the trunk: 0 of those that hang."""
    trunk = _at(points, "l_hip", "r_hip") - _at(points, "neck")
    arms = [_at(points, f"{side}_elbow") - _at(points, f"{side}_shoulder") for side in "lr"]
    cosine = [
        (arm * trunk).sum(-1) / (np.linalg.norm(arm, axis=-1) * np.linalg.norm(trunk, axis=-1))
        for arm in arms
    ]
    raised: Array = 1 - np.stack(cosine)[:, :, 0]
    return raised.ravel()


def _beside(points: Array) -> Array:
    """Level distance of the shoulders from the middle of the feet, metres."""
    feet = _at(points, "l_ankle", "l_toe", "r_ankle", "r_toe")
    apart = _at(points, "l_shoulder", "r_shoulder") - feet
    level: Array = np.linalg.norm(apart[:, 0, [0, 2]], axis=-1)
    return level


def _backwards(side: str) -> Callable[[Array], Array]:
    """Cosines of bent forearms, across upper arms that hang, to the back of the trunk.

    Of raised arms, elbows bend to any side of it.
    """

    def measure(points: Array) -> Array:
        elbow = _at(points, f"{side}_elbow")
        upper, lower = elbow - _at(points, f"{side}_shoulder"), _at(points, f"{side}_wrist") - elbow
        across = _at(points, "l_hip", "l_shoulder") - _at(points, "r_hip", "r_shoulder")
        trunk = _at(points, "neck") - _at(points, "l_hip", "r_hip")
        upper, lower, trunk, ahead = (
            each[:, 0] / np.maximum(np.linalg.norm(each[:, 0], axis=-1, keepdims=True), 1e-9)
            for each in (upper, lower, trunk, np.cross(across, trunk))
        )
        beside = lower - (lower * upper).sum(-1, keepdims=True) * upper
        bend = np.linalg.norm(beside, axis=-1)
        bent = (bend > _BENT) & ((upper * trunk).sum(-1) < _HANGS)
        cosine: Array = -(beside * ahead).sum(-1)[bent] / bend[bent]
        return cosine if len(cosine) else np.zeros(1)

    return measure


# Medians of the six people of the CMU library: slide 0.07 to 0.21 m/s, and 0.6 to 1.5 with wrong
# angles of the root; raised 0.06 to 0.26, and 0.87 to 1.94; beside 0.06 to 0.18 m, and to 0.32;
# backwards -0.94 to -0.73, of single clips to -0.35, and the opposite.
_SLIDE = _Rule(slide, 0.35, 0.35, "the lowest foot moves at {:.2g} m/s in most frames")
_RAISED = _Rule(_raised, 0.7, 0.3, "upper arms do not hang in most frames")
_BESIDE = _Rule(_beside, 0.15, 0.15, "shoulders are {:.2g} m beside the feet in most frames")
_ELBOWS = {
    side: _Rule(_backwards(side[0].lower()), 0.3, -0.3, f"{side.lower()} elbows bend backwards")
    for side in ("Left", "Right")
}
_RULES = (_SLIDE, _RAISED, _BESIDE, *_ELBOWS.values())

_READINGS: tuple[tuple[str, Read], ...] = (
    ("are in columns x, y, z", lambda a: a[..., ::-1]),
    ("are in columns y, z, x", lambda a: a[..., [1, 0, 2]]),
    ("are in columns z, x, y", lambda a: a[..., [0, 2, 1]]),
    ("are in columns y, x, z", lambda a: a[..., [2, 0, 1]]),
    ("are in columns x, z, y", lambda a: a[..., [1, 2, 0]]),
    ("are negated", lambda a: -a),
    ("are in radians", np.degrees),
)


def require_readings(
    path: Path | str,
    clips: Mapping[str, Mapping[str, Array]],
    names: Sequence[str],
    parents: Sequence[int],
    pose: Pose,
) -> None:
    """Refuse motion that is of people only with another order, sign, unit or side of some angles.

    Args:
        path: of the library, or who in it, for messages.
        clips: ``euler_zyx_deg`` (F, J, 3), ``root_m`` (F, 3), ``offsets_m`` (J, 3) by name.
        names: of the joints.
        parents: of the joints.
        pose: angles, root and offsets to landmarks.

    Raises:
        InputError: says what is odd, and of which reading it is not.
    """
    fault = reading_fault(list(clips.values()), names, parents, pose)
    if fault is not None:
        raise InputError(f"{path}: {fault}")


def reading_fault(
    clips: Sequence[Mapping[str, Array]], names: Sequence[str], parents: Sequence[int], pose: Pose
) -> str | None:
    """What is odd about clips, and which reading it is not of; arguments as above."""
    sample = _sample(clips)
    count = sum(len(angles) // 2 for angles, _, _ in sample)
    if count < _FEWEST:
        return None

    def medians(angles: Read, root: Read = lambda a: a) -> dict[_Rule, float]:
        points = np.concatenate(
            [pose(angles(e), root(r), o).reshape(-1, 2, 16, 3) for e, r, o in sample]
        )
        return {rule: float(np.median(rule.measure(points))) for rule in _RULES}

    said = medians(lambda a: a)
    for rule, what, angles, root in _trials(names, parents):
        if said[rule] <= rule.odd:
            continue
        other = medians(angles, root)[rule]
        if other < min(rule.fine, _HALF * said[rule]):
            return (
                f"{rule.what.format(said[rule])}; they would not if {what}: expected "
                "euler_zyx_deg in degrees about z, y and x in this order, each joint's in its own "
                "column, and root_m with y up; convert them"
            )
    return None


def _trials(
    names: Sequence[str], parents: Sequence[int]
) -> Iterator[tuple[_Rule, str, Read, Read]]:
    """What may be wrong: the rule that shows it, in words, and how angles and root are read."""

    def same(values: Array) -> Array:
        return values

    def reader(columns: list[int], read: Read) -> Read:
        def angles(values: Array) -> Array:
            changed = values.copy()
            changed[:, columns] = read(values[:, columns])
            return changed

        return angles

    def other(columns: list[int]) -> Read:
        order = list(range(len(names)))
        for column in columns:
            order[column] = _mirrored(names, column)
        return lambda values: values[:, order]

    def of(*ends: str) -> list[int]:
        wanted = {side + end for side in ("Left", "Right") for end in ends}
        return [k for k, name in enumerate(names) if name in wanted]

    arms, legs = of("Shoulder", "Arm", "ForeArm", "Hand"), of("UpLeg", "Leg", "Foot")
    sides = "left and right are exchanged in columns"
    yield _SLIDE, f"{sides} of joints", other(list(range(len(names)))), same
    yield _RAISED, f"{sides} of arms", other(arms), same
    groups = ((_SLIDE, "the root", [0]), (_SLIDE, "legs", legs), (_RAISED, "arms", arms))
    for rule, whose, columns in groups:
        for what, read in _READINGS:
            yield rule, f"angles of {whose} {what}", reader(columns, read), same
    yield _SLIDE, "root_m has z up", same, lambda root: root[:, [0, 2, 1]] * [1, 1, -1]
    spine = _spine(names, parents)
    yield _BESIDE, "angles of the spine are negated", reader(spine, lambda a: -a), same
    for side, rule in _ELBOWS.items():
        forearm = [k for k, name in enumerate(names) if name == f"{side}ForeArm"]
        yield rule, f"angles of {side}ForeArm are negated", reader(forearm, lambda a: -a), same


def _mirrored(names: Sequence[str], column: int) -> int:
    """The column of the same joint on the other side; its own where there is none."""
    name = names[column]
    for side, other in (("Left", "Right"), ("Right", "Left")):
        if name.startswith(side) and other + name.removeprefix(side) in names:
            return list(names).index(other + name.removeprefix(side))
    return column


def _spine(names: Sequence[str], parents: Sequence[int]) -> list[int]:
    """Columns of the joints between the root and the neck."""
    column, found = int(parents[list(names).index("Neck")]), []
    while column > 0:
        found.append(column)
        column = int(parents[column])
    return found


def sliding(clips: Iterable[NDArray[np.float32]]) -> Iterator[str]:
    """What speaks against landmarks of clips (F, 16, 3): nobody ever stands.

    No reason to refuse them: so it is on ice, and where somebody is on a treadmill or swims.
    """
    pairs = [np.stack((points[:-1], points[1:]), 1).astype(float) for points in clips]
    if sum(map(len, pairs)) < _WARNED:
        return
    speed = float(np.median(slide(np.concatenate(pairs))))
    if speed > _SLIDING:
        yield (
            f"the lowest foot moves at {speed:.2g} m/s in most frames, {_SLIDING} at most where "
            "people walk and stand: if they do not skate, or move on a treadmill, euler_zyx_deg of "
            "the root, or root_m, are not of this motion"
        )


def leap_doubts(clips: Iterable[NDArray[np.float32]]) -> Iterator[str]:
    """What speaks against frames of landmarks of clips (F, 16, 3): no limb leaps there and back."""
    leaps = [leaping(torch.from_numpy(points))[1:-1] for points in clips]
    share = float(torch.cat(leaps).double().mean()) if sum(map(len, leaps)) else 0.0
    if share > LEAPING:
        yield (
            f"joints leap by {LEAP} m or more from one frame to the next in {share:.1%} of the "
            "frames, as where some were lost and filled with zeros, or angles were interpolated "
            "over half a turn: leave these out, or mark their clips as glitch in the remark column"
        )


def _sample(clips: Sequence[Mapping[str, Array]]) -> list[tuple[Array, Array, Array]]:
    """Frames, each with the one after it, of all clips: angles (2F, J, 3), root, offsets."""
    total = sum(len(clip["root_m"]) - 1 for clip in clips)
    step = max(1, total // _PAIRS)
    parts = []
    for clip in clips:
        first = np.arange(0, len(clip["root_m"]) - 1, step)
        frames = np.stack((first, first + 1), 1).ravel()
        if len(frames):
            parts.append((clip["euler_zyx_deg"][frames], clip["root_m"][frames], clip["offsets_m"]))
    return parts
