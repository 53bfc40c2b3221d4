"""The joint set of an estimator, as the layer takes it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches

from perfcap.detect.joint_set import (
    KNOWN_JOINTS,
    LANDMARKS,
    JointSet,
    canonical_name,
    doubled_names,
    find_joint_set,
)
from perfcap.errors import InputError
from perfcap.pipeline.config import PoseConfig

_NEAR = 0.85  # of letters that two spellings share: r_elbo and r_elbow, not r_hand and r_ankle
_LONGEST = 40  # letters that are compared, of whatever a set calls its joints


def known_joints(joint_set: JointSet | str) -> JointSet:
    """A set of joints that poses can be found of.

    Warns, on behalf of the caller of the caller, of names that are nearly those of landmarks
    which the set lacks: they may be joints that are called like this.

    Raises:
        InputError: it is not known, spells landmarks another way, or lacks hips or shoulders.
    """
    joint_set = find_joint_set(joint_set)
    missing = joint_set.missing()
    spelled = [f"{own} (expected {mark})" for own, mark in _misspelled(joint_set, missing)]
    if spelled:
        raise InputError(
            f"joint_set {joint_set.name!r} has names that are not ours: {', '.join(spelled)}; as "
            "they are, these joints would be left out"
        )
    twice = doubled_names([own for own in joint_set.joints if _on_a_side(canonical_name(own))])
    if twice:
        raise InputError(
            f"joint_set {joint_set.name!r} has {twice:.200}, the same joint; expected each joint "
            "once: rename what is not it"
        )
    near = ", ".join(f"{own} (nearly {mark})" for own, mark in _nearly(joint_set, missing))
    lacking = [name for name in ("l_hip", "r_hip", "l_shoulder", "r_shoulder") if name in missing]
    if lacking:
        has = f", but has {near}" if near else ""
        raise InputError(
            f"joint_set {joint_set.name!r} lacks {', '.join(lacking)}, without which no pose can "
            f"be found{has}; give the names of the estimator's joints in its order"
        )
    if near:
        warnings.warn(
            f"PoseRefiner: joint_set {joint_set.name!r} has {near}: these joints are left out; if "
            "they are these landmarks, spell them so",
            stacklevel=3,
        )
    return joint_set


def _misspelled(joint_set: JointSet, missing: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Joints on a side in another spelling, with the landmark that they are and the set lacks."""
    for own in joint_set.joints:
        mark = canonical_name(own)
        if mark != own and mark in missing and mark[:2] in ("l_", "r_"):
            yield own, mark


def _on_a_side(name: str) -> bool:
    """Whether it is a joint of ours on a side: a set may have a ``head`` beside the crown."""
    return name[:2] in ("l_", "r_") and name in KNOWN_JOINTS


def _nearly(joint_set: JointSet, missing: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Joints of unknown names, with the landmark that is called nearly so and the set lacks."""
    for own in joint_set.joints:
        name = canonical_name(own[:_LONGEST])
        if name in KNOWN_JOINTS:
            continue
        side = name[:2] if name[:2] in ("l_", "r_") else ""  # another side is no slip of the pen
        marks = [mark for mark in missing if mark.startswith(side)]
        yield from ((own, mark) for mark in get_close_matches(name, marks, 1, _NEAR))


def without_missing(config: PoseConfig, joint_set: JointSet) -> PoseConfig:
    """The configuration for 3D joints some of which the set does not have."""
    missing = joint_set.missing()
    pairs = zip(LANDMARKS, config.position.deviation, strict=True)
    deviation = tuple(float("inf") if name in missing else own for name, own in pairs)
    return replace(config, position=replace(config.position, deviation=deviation))
