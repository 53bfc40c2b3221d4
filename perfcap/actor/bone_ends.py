"""Landmarks beyond the last joints: the top of the head and the toes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_map import BoneMap
from perfcap.actor.template import Template

Floats = NDArray[np.float64]

_HOLDERS = {"head_top": "head", "l_toe": "l_ankle", "r_toe": "r_ankle"}
_HEAD, _FOOT = 0.10, 0.13  # lengths beyond the last joint in statures, where there is no skin
# people mark toes neither at their tips nor on the ground
_TOE_REACH, _TOE_HEIGHT = 0.8, 0.02  # of the way to the tip, and in statures above the sole


def end_landmarks(
    template: Template, bones: BoneMap, owners: Sequence[int]
) -> dict[str, tuple[int, Floats]]:
    """Bone and rest position (3,) of head_top, l_toe and r_toe.

    Where a bone begins at a landmark, it is there; otherwise the skin tells.

    Args:
        template: in metres, y up, facing +z.
        bones: its joints.
        owners: index of the joint each bone moves with, (B,).
    """
    joint_of = np.asarray(owners)[template.weight_bones[:, 0]]
    stature = float(np.ptp(template.vertices[:, 1]))
    result: dict[str, tuple[int, Floats]] = {}
    for name, holder in _HOLDERS.items():
        bone = bones.joints[holder]
        start = template.bone_rest[bone, :3, 3]
        skin = template.vertices[joint_of == JOINTS.index(holder)]
        if name in bones.ends:
            place = template.bone_rest[bones.ends[name], :3, 3]
        elif name == "head_top":
            place = _head_top(start, skin, stature)
        else:
            place = _toe(start, skin, stature)
        result[name] = (bone, np.array(place))
    return result


def _head_top(head: Floats, skin: Floats, stature: float) -> Floats:
    top = skin[:, 1].max(initial=head[1]) if len(skin) else head[1] + _HEAD * stature
    return np.array([head[0], top, head[2]])


def _toe(ankle: Floats, skin: Floats, stature: float) -> Floats:
    if not len(skin):
        return np.asarray(ankle + np.array([0.0, -_TOE_HEIGHT, _FOOT]) * stature)
    away = (skin - ankle)[:, [0, 2]]
    tip = away[np.linalg.norm(away, axis=1).argmax()]
    height = min(float(skin[:, 1].min()) + _TOE_HEIGHT * stature, float(ankle[1]))
    forward, side = ankle[[2, 0]] + _TOE_REACH * tip[[1, 0]]
    return np.array([side, height, forward])
