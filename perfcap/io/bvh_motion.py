"""A skeleton in motion as BVH files describe it.

A joint frame has the world's axes in the rest pose. Joints may move against their parent: their
position replaces the rest offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template
from perfcap.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BvhMotion:
    """A skeleton and its motion.

    Attributes:
        names: joint names, (J,).
        parents: parent of each joint, -1 for the one root, parents first, (J,).
        offsets: rest position of each joint in its parent, world axes, (J, 3) m.
        rotations: joint-to-parent rotations, (F, J, 3, 3).
        positions: joint origins in the parent's frame, the root's in the world, (F, J, 3) m.
        frame_time: seconds between frames.
        ends: tip of each leaf in its joint's frame, NaN for the others, (J, 3) m; None to
            prolong each leaf by a quarter of its own offset.
    """

    names: tuple[str, ...]
    parents: Integers
    offsets: Floats
    rotations: Floats
    positions: Floats
    frame_time: float
    ends: Floats | None = None

    def __post_init__(self) -> None:
        joints, frames = len(self.names), len(self.rotations)
        parents = np.asarray(self.parents)
        expected = {"offsets": (joints, 3), "positions": (frames, joints, 3)}
        for name, shape in (expected | {"rotations": (frames, joints, 3, 3)}).items():
            array = getattr(self, name)
            if array.shape != shape or not np.isfinite(array).all():
                raise InputError(f"{name} has shape {array.shape}; expected finite {shape}")
        if parents.shape != (joints,) or not joints or not frames:
            raise InputError(f"{joints} joints with parents {parents.shape} and {frames} frames")
        if parents[0] != -1 or np.any(parents[1:] < 0) or np.any(parents >= np.arange(joints)):
            raise InputError("parents has no single root first; BVH holds one tree, parents first")
        if not (np.isfinite(self.frame_time) and self.frame_time > 0):
            raise InputError(f"frame_time is {self.frame_time}; expected seconds above zero")


def bvh_motion(template: Template, bone_transforms: Floats, fps: float) -> BvhMotion:
    """Motion of an actor's own skeleton.

    BVH holds one tree: roots after the first hang on the first one, against which they may move.

    Args:
        template: the rig; its bones become the joints.
        bone_transforms: rigid rest-to-posed transforms in the world, (F, B, 4, 4) m.
        fps: frames per second.
    """
    parents = np.where(template.bone_parents < 0, 0, template.bone_parents)
    parents[0] = -1
    rest = template.bone_rest[:, :3, 3]
    above = np.maximum(parents, 0)
    turned = bone_transforms[..., :3, :3]
    posed = (turned @ rest[:, :, None])[..., 0] + bone_transforms[..., :3, 3]
    to_parent = np.where((parents < 0)[:, None, None], np.eye(3), turned[:, above].mT)
    origin = np.where((parents < 0)[:, None], 0.0, posed[:, above])
    return BvhMotion(
        names=template.bone_names,
        parents=parents,
        offsets=rest - np.where((parents < 0)[:, None], 0.0, rest[above]),
        rotations=to_parent @ turned,
        positions=(to_parent @ (posed - origin)[..., None])[..., 0],
        frame_time=1 / fps,
    )


def joint_positions(motion: BvhMotion) -> Floats:
    """World positions of the joints, (F, J, 3) m."""
    rotations, places = motion.rotations.copy(), motion.positions.copy()
    for joint, parent in enumerate(motion.parents.tolist()):
        if parent >= 0:
            above = rotations[:, parent]
            places[:, joint] = places[:, parent] + (above @ places[:, joint, :, None])[..., 0]
            rotations[:, joint] = above @ rotations[:, joint]
    return places
