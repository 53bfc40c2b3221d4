"""Whether an actor's landmarks and joint limits are those of its body."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import CENTRE_LIMITS, SIDE_LIMITS
from perfcap.actor.rig import Rig
from perfcap.actor.template import Template
from perfcap.io.actor_limbs import joint_places
from perfcap.io.doctor.finding import Finding, Severity

Floats = NDArray[np.float64]

# Of the height: tubes as thin as limbs have 0.05 around the crown, skins of people 0.02.
_FROM_SKIN = 0.1
_BACKWARDS = -0.2  # cosine between a foot and where hips and shoulders face; of people 0.9
_BELOW = 0.01  # of the height, that a crown may be below the joint of the head
_ABOVE, _AROUND = 0.04, 0.1  # the same above the mesh around it; of people it is 0.02 below
_UNDER = 0.01  # the same of toes below the mesh; those of people lie inside of it
_TOES = ("l_toe", "r_toe")
_PLACES = {"head_top": "head", "l_toe": "l_ankle", "r_toe": "r_ankle"}
_USUAL = {**CENTRE_LIMITS, **SIDE_LIMITS}
_LEFT, _MIRRORED = 0.25, 0.5  # of what people's joints may turn


def landmark_findings(template: Template) -> Iterator[Finding]:
    """Crowns and toes that are not at their places.

    Crowns lie below heads or above the mesh, toes at the other foot, behind it or below the mesh,
    or either far from the body.

    Args:
        template: in metres, with the joints of a person; landmarks that are missing are left out.
    """
    at = joint_places(template)
    height = float(np.ptp(template.vertices[:, 1]))
    odd = [
        f"{name} lies {words}"
        for name, holder in _PLACES.items()
        if name in at and (words := _misplaced(name, at[name], at[holder], at, template, height))
    ]
    if odd:
        remedy = "correct [landmarks] in manifest.toml, or build the actor again"
        yield Finding(Severity.ERROR, "landmarks", "; ".join(odd), remedy)
        return
    vertices = template.vertices
    if "head_top" in at and (above := above_mesh(at["head_top"], vertices)) > _ABOVE * height:
        what = f"head_top lies {100 * above:.0f} cm above the mesh"
        remedy = "put the bone that ends the head at the crown, or correct [landmarks]"
        yield Finding(Severity.WARNING, "landmarks", what, remedy)
    toes = [float(at[name][1]) for name in _TOES if name in at]
    under = float(vertices[:, 1].min()) - max(toes, default=math.inf)
    if under > _UNDER * height:
        what = f"toes lie {100 * under:.0f} cm below the mesh, as where its feet were cut off"
        remedy = (
            "keep the soles of a scan: without them a height that is given makes the rest too large"
        )
        yield Finding(Severity.WARNING, "landmarks", what, remedy)


def _misplaced(
    name: str, place: Floats, holder: Floats, at: dict[str, Floats], template: Template, size: float
) -> str | None:
    """Where a landmark (3,) is that is not at its place, in words."""
    away = float(np.linalg.norm(template.vertices - place, axis=1).min())
    if away > _FROM_SKIN * size:
        return f"{100 * away:.0f} cm from the mesh"
    if name == "head_top":
        low = float(holder[1] - place[1])
        return f"{100 * low:.0f} cm below the head's joint" if low > _BELOW * size else None
    other = at["r_ankle" if name[0] == "l" else "l_ankle"]
    if np.linalg.norm(place - other) < np.linalg.norm(place - holder):
        return "at the other foot"
    across = at["l_hip"] - at["r_hip"] + at["l_shoulder"] - at["r_shoulder"]
    ahead, foot = np.cross(across, [0.0, 1.0, 0.0]), (place - holder) * [1.0, 0.0, 1.0]
    length = float(np.linalg.norm(ahead) * np.linalg.norm(place - holder))
    return "behind the ankle" if float(ahead @ foot) < _BACKWARDS * length else None


def above_mesh(place: Floats, vertices: Floats) -> float:
    """Metres that a place (3,) is above the vertices (v, 3) around it, as seen from above."""
    height = float(np.ptp(vertices[:, 1]))
    aside = np.linalg.norm((vertices - place)[:, [0, 2]], axis=1)
    around = vertices[aside < _AROUND * height, 1]
    return float(place[1] - (around if len(around) else vertices[:, 1]).max())


def limit_findings(rig: Rig) -> Iterator[Finding]:
    """Limits that leave little of what people's joints may turn, or bend them the other way."""
    odd = []
    for hinge in rig.hinges:
        usual = _USUAL.get(hinge.name.removeprefix("l_").removeprefix("r_"))
        if usual is None:
            continue
        low, high = math.degrees(hinge.lower), math.degrees(hinge.upper)
        left, turned = (_common(ends, usual[:2]) for ends in ((low, high), (-high, -low)))
        if left < _LEFT or turned > left + _MIRRORED:
            odd.append(f"{hinge.name} {low:.3g} to {high:.3g} of {usual[0]:g} to {usual[1]:g}")
    if odd:
        what = f"leave little of the degrees that people's joints turn: {', '.join(odd)}"
        remedy = "look at their signs, and that they are degrees, unless the person is so stiff"
        yield Finding(Severity.WARNING, "limits", what, remedy)


def _common(ends: tuple[float, float], usual: tuple[float, float]) -> float:
    """Share of the usual range that lies between two ends."""
    overlap = min(ends[1], usual[1]) - max(ends[0], usual[0])
    return max(0.0, overlap) / (usual[1] - usual[0])
