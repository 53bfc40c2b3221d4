"""Which side of a body is the left one: the one on the left of where the feet point."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template

Floats = NDArray[np.float64]

SURE = 0.2  # cosine between feet and trunk that tells left from right
_NEEDED = {"l_hip", "r_hip", "l_ankle", "r_ankle", "neck"}


def facing(template: Template, joints: Mapping[str, int]) -> float:
    """Cosine between where the feet point and where the trunk faces, by its left and right.

    Negative where left and right are exchanged, zero where there is no telling for want of feet.

    Args:
        template: the rigged mesh, in any units and with any axis up.
        joints: bone of each joint.
    """
    at = {name: template.bone_rest[bone, :3, 3] for name, bone in joints.items()}
    if not at.keys() >= _NEEDED:
        return 0.0
    up = at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"])
    up = up / max(float(np.linalg.norm(up)), 1e-12)
    ahead = np.cross(at["l_hip"] - at["r_hip"], up)
    points = sum((_foot(template, joints[f"{side}_ankle"], up) for side in "lr"), np.zeros(3))
    length = float(np.linalg.norm(ahead) * np.linalg.norm(points))
    return float(ahead @ points) / length if length > 0 else 0.0


def exchanged(bones: Mapping[str, int]) -> dict[str, int]:
    """The same bones by joint with left and right exchanged."""
    other = {"l_": "r_", "r_": "l_"}
    return {other.get(name[:2], name[:2]) + name[2:]: bone for name, bone in bones.items()}


def _foot(template: Template, ankle: int, up: Floats) -> Floats:
    """Level vector from the ankle to the part of the foot that is furthest from it, (3,)."""
    below = np.zeros(len(template.bone_names), dtype=np.bool_)
    below[ankle] = True
    for bone, parent in enumerate(template.bone_parents.tolist()):
        below[bone] |= parent >= 0 and below[parent]
    skin = template.vertices[below[template.weight_bones[:, 0]]]
    if not len(skin):
        return np.zeros(3)
    away = skin - template.bone_rest[ankle, :3, 3]
    away = away - np.outer(away @ up, up)
    return np.asarray(away[np.linalg.norm(away, axis=1).argmax()])
