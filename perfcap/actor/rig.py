"""A skeleton as plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from torch import Tensor

from perfcap.errors import InputError


@dataclass(frozen=True)
class Hinge:
    """One angle: a joint turning about a fixed axis.

    Attributes:
        name: of the angle.
        joint: the joint that turns.
        axis: unit axis in rest coordinates, carried along by the joint's parent and by the
            joint's earlier hinges.
        lower, upper: limits, radians.
        rest: the angle of the rest pose, radians.
    """

    name: str
    joint: str
    axis: tuple[float, float, float]
    lower: float
    upper: float
    rest: float = 0.0

    def __post_init__(self) -> None:
        if not self.lower <= self.upper or not math.isfinite(self.rest):
            raise InputError(
                f"hinge {self.name!r} has lower {self.lower}, upper {self.upper} and rest "
                f"{self.rest}; expected radians, the lower limit first"
            )
        if not (any(self.axis) and all(map(math.isfinite, self.axis))):
            raise InputError(
                f"hinge {self.name!r} has the axis {self.axis}, about which nothing turns; "
                "expected a vector of length one"
            )


@dataclass(frozen=True)
class Clavicle:
    """A joint without angles of its own, which turns as the arm that it carries is lifted.

    It carries the place of the arm, not its rotation: angles of the shoulder stay relative to the
    chest. How far it turns is in ``clavicle_turns.py``.

    Attributes:
        joint: the clavicle's; its position is where it begins, and its parent is the chest.
        carried: the shoulder, which has the same parent.
        axis: unit axis in rest coordinates, carried along by the chest; positive turns lift.
        range: radians, from an arm that hangs to one that points up.
        lifts: names of the hinges of the shoulder that lift the arm, at 0 where it hangs.
    """

    joint: str
    carried: str
    axis: tuple[float, float, float]
    range: float
    lifts: tuple[str, str]


@dataclass(frozen=True)
class Rig:
    """A skeleton as plain data; lengths in metres, all positions in the rest pose.

    Attributes:
        joints: names, parents before children; the first is the root.
        parents: index of each joint's parent, -1 for the root.
        positions: of the joints, (J, 3).
        hinges: in the order of the angles; a joint's hinges are applied from first (at the
            parent) to last (at the bone).
        landmarks: names of the points that detections speak of.
        landmark_joints: the joint each landmark is rigidly attached to.
        landmark_positions: (L, 3).
        bone_groups: name of the group whose length each bone shares: one for each joint's bone
            from its parent (the root's is ignored), then one for each landmark's from its joint.
            All bones share one group where it is empty.
        roles: the joint that stands for each of the sixteen of a person, in their order, where
            joints are others: those of a robot. Empty where they are a person's.
        neutral: what turns those sixteen from rest to the anatomical neutral pose, (16, 3, 3);
            None where angles of 0 do.
        clavicles: those of the joints that are; they come last.
    """

    joints: tuple[str, ...]
    parents: tuple[int, ...]
    positions: Tensor
    hinges: tuple[Hinge, ...]
    landmarks: tuple[str, ...]
    landmark_joints: tuple[int, ...]
    landmark_positions: Tensor
    bone_groups: tuple[str, ...] = ()
    roles: tuple[int, ...] = ()
    neutral: Tensor | None = None
    clavicles: tuple[Clavicle, ...] = ()

    @property
    def without_clavicles(self) -> tuple[int, ...]:
        """Each joint, and in place of a clavicle the joint that it hangs on, (J,)."""
        names = {clavicle.joint for clavicle in self.clavicles}
        return tuple(
            parent if name in names else joint
            for joint, (name, parent) in enumerate(zip(self.joints, self.parents, strict=True))
        )

    def __post_init__(self) -> None:
        if self.parents[:1] != (-1,) or min(self.parents[1:], default=0) < 0:
            raise InputError("skeleton needs one root, its first joint; attach the others to it")
        if any(parent >= joint for joint, parent in enumerate(self.parents)):
            raise InputError("skeleton joints must follow their parents; sort them from the root")
        self._check_counts()
        if not (self.positions.isfinite().all() and self.landmark_positions.isfinite().all()):
            raise InputError(
                "skeleton has positions of joints or landmarks that are not finite numbers"
            )
        unknown = {hinge.joint for hinge in self.hinges} - set(self.joints)
        if unknown:
            raise InputError(
                f"skeleton has hinges on {', '.join(sorted(unknown))}, which are no joints of it"
            )
        self._check_clavicles()

    def _check_counts(self) -> None:
        """Loops over the tree believe them, and did not end at a landmark of no joint."""
        joints, marks = len(self.joints), len(self.landmarks)
        if len(self.parents) != joints or tuple(self.positions.shape) != (joints, 3):
            raise InputError(
                f"skeleton has {joints} joints, {len(self.parents)} parents and positions "
                f"{tuple(self.positions.shape)}; expected one of each joint, (J, 3)"
            )
        places = tuple(self.landmark_positions.shape)
        if len(self.landmark_joints) != marks or places != (marks, 3):
            raise InputError(
                f"skeleton has {marks} landmarks, on {len(self.landmark_joints)} joints and at "
                f"positions {places}; expected one of each landmark, (L, 3)"
            )
        if any(not 0 <= joint < joints for joint in (*self.landmark_joints, *self.roles)):
            raise InputError(
                f"skeleton has landmarks on joints {self.landmark_joints} and roles {self.roles}; "
                f"expected numbers from 0 to {joints - 1}"
            )
        if len(set(self.joints)) < joints:
            raise InputError("skeleton has joints of the same name; expected one for each")
        angles = [hinge.name for hinge in self.hinges]
        for what, names in (("hinges", angles), ("landmarks", list(self.landmarks))):
            if len(set(names)) < len(names):
                twice = sorted({name for name in names if names.count(name) > 1})
                raise InputError(
                    f"skeleton has several {what} called {', '.join(twice)}; expected a name for "
                    "each, by which results and limits are found"
                )
        if self.bone_groups and len(self.bone_groups) != joints + marks:
            raise InputError(
                f"skeleton has {len(self.bone_groups)} bone groups; expected one for each of its "
                f"{joints} joints and {marks} landmarks, or none"
            )

    def _check_clavicles(self) -> None:
        names = tuple(clavicle.joint for clavicle in self.clavicles)
        first, parents = (
            len(self.joints) - len(names),
            dict(zip(self.joints, self.parents, strict=True)),
        )
        hinges = {hinge.name: hinge.joint for hinge in self.hinges}
        if self.joints[first:] != names or max(self.parents) >= first > 0:
            raise InputError("skeleton has clavicles that are not its last joints, or carry others")
        for clavicle in self.clavicles:
            lifted = {hinges.get(name) for name in clavicle.lifts}
            same = parents.get(clavicle.carried) == parents[clavicle.joint]
            if not same or lifted != {clavicle.carried}:
                raise InputError(
                    f"skeleton has {clavicle.joint} that carries {clavicle.carried}; expected a "
                    "joint with the same parent, and two of its hinges"
                )


def with_still_shoulders(rig: Rig) -> Rig:
    """The rig without its clavicles, which are its last joints: shoulders stay on the chest."""
    count = len(rig.joints) - len(rig.clavicles)
    return replace(
        rig,
        joints=rig.joints[:count],
        parents=rig.parents[:count],
        positions=rig.positions[:count],
        bone_groups=(*rig.bone_groups[:count], *rig.bone_groups[len(rig.joints) :]),
        clavicles=(),
    )


def with_limits(rig: Rig, limits: Mapping[str, tuple[float, float]]) -> Rig:
    """The rig with other limits (lower, upper), radians, of some of its angles.

    Raises:
        InputError: there is no such angle, or the limits are not in order.
    """
    unknown = set(limits) - {hinge.name for hinge in rig.hinges}
    if unknown:
        known = ", ".join(hinge.name for hinge in rig.hinges)
        raise InputError(f"limits: {', '.join(sorted(unknown))} is no angle; expected {known}")
    for name, (lower, upper) in limits.items():
        if not lower < upper:
            raise InputError(f"limits: {name} is {lower} to {upper}; expected lower below upper")
    return replace(
        rig,
        hinges=tuple(
            replace(hinge, lower=limits[hinge.name][0], upper=limits[hinge.name][1])
            if hinge.name in limits
            else hinge
            for hinge in rig.hinges
        ),
    )
