"""What of a person a scan lacks: its crown, its soles, or a limb."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.template import Template
from perfcap.io.actor_points import above_mesh

Floats = NDArray[np.float64]

# Of the height: how far the body's crown may be above the mesh (0 at most of people who are all
# there), and its toes below (-0.012).
_CROWN, _SOLES = 0.008, -0.003
# How many times as much surface a joint may move on one side as on the other: 1.07 at most of
# people who are all there. Where an arm is missing, that of the body lies in the trunk.
# `python experiments/cut_scans.py` cuts parts off.
_UNLIKE = 1.25
_PARTS = {
    **{"shoulder": "upper arm", "elbow": "forearm", "wrist": "hand"},
    **{"hip": "thigh", "knee": "shank", "ankle": "foot"},
}


def missing_parts(template: Template, scaled: bool) -> Iterator[str]:
    """Sentences about a mesh that ends below a crown or above soles, or has unlike limbs.

    Args:
        template: the mesh on the bones of the body that was fitted into it, metres, y up.
        scaled: whether it was scaled to a height that is given.
    """
    vertices, place = template.vertices, {k: at for k, (_, at) in template.landmarks.items()}
    size = float(np.ptp(vertices[:, 1]))
    crown = above_mesh(place["head_top"], vertices)
    soles = float(vertices[:, 1].min() - max(place[name][1] for name in ("l_toe", "r_toe")))
    larger = ": the height given makes all the rest too large" if scaled else ""
    if crown > _CROWN * size:
        yield (
            f"the crown of the body in it lies {100 * crown:.0f} cm above the mesh, as where hair "
            f"or the top of the head was not scanned{larger}"
        )
    if soles > _SOLES * size:
        yield (
            "the mesh goes no deeper than the toes' joints of the body in it, as where soles were "
            f"cut off with the floor{larger}"
        )
    area = _moved_by_joints(template)
    unlike = [
        f"{left / max(right, 1e-9):.1f} times as much left {part} as right"
        for joint, part in _PARTS.items()
        for left, right in [(area[f"l_{joint}"], area[f"r_{joint}"])]
        if max(left, right) > _UNLIKE * min(left, right)
    ]
    if unlike:
        yield (
            f"the mesh has {', '.join(unlike)}, as where a limb is not all there, or something is "
            "carried; look at the colours of the contact sheet"
        )


def _moved_by_joints(template: Template) -> dict[str, float]:
    """Square metres of the surface that each joint moves."""
    corners = template.vertices[template.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    moved = area @ template.dense_weights()[template.faces].mean(1)
    return {joint: float(moved[template.bone(joint)]) for joint in JOINTS}
