"""What speaks against a scan: it lacks a crown, soles or a part of a limb, or raises its hands."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.template import Template
from perfcap.io.actor_points import above_mesh

Floats = NDArray[np.float64]

# `python experiments/cut_scans.py` cuts parts off and counts what is named.
# Of the height: how far the crown of the body may be above the mesh, and its toes below. Where
# nothing is missing, the crown is at most as high as the mesh, and toes lie inside of it.
_CROWN, _SOLES = 0.008, -0.003
# How many times as much surface a joint may move on one side as on the other. Where an arm is
# missing, that of the body lies in the trunk, and several joints differ; one alone may where arms
# are bent unlike.
_UNLIKE, _ALONE = 1.25, 1.6
_HARDLY = 0.2
_PARTS = {
    **{"shoulder": "upper arm", "elbow": "forearm", "wrist": "hand"},
    **{"hip": "thigh", "knee": "shank", "ankle": "foot"},
}


def scan_doubts(template: Template, scaled: bool) -> Iterator[str]:
    """Sentences about a mesh that is not all of a person, or holds its hands above its head.

    It ends below the crown or above the soles of the body in it, or left and right are unlike.

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
    weights = template.dense_weights()
    raised = template.bone_names[int(weights[vertices[:, 1].argmax()].argmax())]
    if scaled and raised[2:] in ("elbow", "wrist"):
        yield (
            f"what {raised} moves is higher than the head: the height given is that of raised "
            "hands, and makes all the rest too small"
        )
    area = _moved_by_joints(template)
    sides = {part: (area[f"l_{joint}"], area[f"r_{joint}"]) for joint, part in _PARTS.items()}
    ratios = {part: max(pair) / max(min(pair), 1e-9) for part, pair in sides.items()}
    unlike = [
        _compared(part, left, right)
        for part, (left, right) in sides.items()
        if ratios[part] > _UNLIKE
    ]
    if len(unlike) > 1 or max(ratios.values()) > _ALONE:
        yield (
            f"the mesh has {', '.join(unlike)}, as where a limb is not all there, or something is "
            "carried; look at the colours of the contact sheet"
        )


def _compared(part: str, left: float, right: float) -> str:
    if min(left, right) < _HARDLY * max(left, right):
        return f"hardly any {'left' if left < right else 'right'} {part}"
    return f"{left / right:.1f} times as much left {part} as right"


def _moved_by_joints(template: Template) -> dict[str, float]:
    """Square metres of the surface that each joint moves."""
    corners = template.vertices[template.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    moved = area @ template.dense_weights()[template.faces].mean(1)
    return {joint: float(moved[template.bone(joint)]) for joint in JOINTS}
