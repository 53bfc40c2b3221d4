"""Whether an actor's joints lie where its limbs bend."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.template import Template
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.finding import Finding, Severity

Floats = NDArray[np.float64]

LIMBS = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
_ENDS = {"head_top", "l_toe", "r_toe"}
_UNEVEN = 1.15  # times the other side's
# Lengths against each other, of people 1.00 to 1.32, 0.61 to 1.29, 0.56 to 0.66, 0.56 to 0.88,
# 0.48 to 0.82, 0.59 to 0.80, 0.30 to 0.43 and 0.40 to 0.60 (experiments/joint_places.py); drawn
# characters may go further.
_USUAL = {
    ("upper arms", "forearms"): (0.75, 1.7),
    ("thighs", "shanks"): (0.55, 1.6),
    ("arms", "legs"): (0.45, 0.85),
    ("shoulders", "arms"): (0.4, 1.0),
    ("hips", "shoulders"): (0.35, 0.97),
    ("trunk", "legs"): (0.5, 1.0),
    ("feet", "shanks"): (0.2, 0.6),
    ("heads", "trunk"): (0.28, 0.8),
}
_ABOVE = {"elbow": "shoulder", "knee": "hip"}
_BELOW = {"shoulder": ("elbow", "wrist"), "hip": ("knee", "ankle")}
_AXES = {"elbow": "wrist", "knee": "ankle", "shoulder": "elbow", "hip": "knee"}  # where limbs end
# How far along a limb, in lengths of it, weights may cross over from the joint: knees of `ada` do
# at 0.01 to 0.11, and skirts at 0.18 of the thigh from the hip.
_ALONG = {
    "elbow": (-0.12, 0.08),
    "knee": (-0.09, 0.09),
    "shoulder": (-0.25, 0.25),
    "hip": (-0.12, 0.32),
}
_CROSSINGS = 8  # edges; fewer are of a coarse mesh, or of rigid parts that touch


def limb_findings(template: Template) -> Iterator[Finding]:
    """Findings about a template in metres whose joints are known."""
    yield from _lengths(template)
    yield from _proportions(template)
    yield from _bends(template)


def carried_by(template: Template, bone: int) -> set[int]:
    """A bone and those that hang on it, joints excepted."""
    joints = set(template.joint_bones.values())
    inside = {bone}
    for child, parent in enumerate(template.bone_parents.tolist()):
        if parent in inside and child not in joints:
            inside.add(child)
    return inside


def joint_places(template: Template) -> dict[str, Floats]:
    """Where joints and landmarks rest, (3,) each, metres."""
    ends = {name: bone for bone, name in enumerate(template.bone_names) if name in LANDMARKS}
    bones = {**ends, **template.joint_bones}
    places = {name: template.bone_rest[bone, :3, 3] for name, bone in bones.items()}
    return places | {name: np.asarray(place) for name, (_, place) in template.landmarks.items()}


def _lengths(template: Template) -> Iterator[Finding]:
    """Bones of one side that are longer than the other's: a joint lies at the wrong place."""
    at = joint_places(template)
    odd = []
    feet = (("ankle", "toe"),) if at.keys() >= _ENDS else ()
    for upper, lower in (*LIMBS, *feet):
        left, right = (
            float(np.linalg.norm(at[f"{side}_{upper}"] - at[f"{side}_{lower}"])) for side in "lr"
        )
        if max(left, right) > _UNEVEN * min(left, right):
            odd.append(f"from {upper} to {lower} {100 * left:.0f} and {100 * right:.0f} cm")
    if odd:
        what = f"left and right differ, {'; '.join(odd)}"
        remedy = "put the bones at the joints, or name others in a mapping file"
        yield Finding(Severity.WARNING, "limbs", what, remedy)


def proportions(template: Template) -> dict[str, float]:
    """Lengths against each other, both sides' mean, by what they are of.

    Feet and heads are left out without landmarks.
    """
    at = joint_places(template)

    def length(start: str, end: str) -> float:
        return sum(float(np.linalg.norm(at[f"{s}_{start}"] - at[f"{s}_{end}"])) for s in "lr") / 2

    upper, lower, thigh, shank = (length(start, end) for start, end in LIMBS)
    sizes = {
        "upper arms": upper,
        "forearms": lower,
        "thighs": thigh,
        "shanks": shank,
        "arms": upper + lower,
        "legs": thigh + shank,
        "shoulders": float(np.linalg.norm(at["l_shoulder"] - at["r_shoulder"])),
        "hips": float(np.linalg.norm(at["l_hip"] - at["r_hip"])),
        "trunk": float(np.linalg.norm(at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"]))),
    }
    if at.keys() >= _ENDS:
        sizes["feet"] = length("ankle", "toe")
        sizes["heads"] = float(np.linalg.norm(at["head_top"] - at["neck"]))
    pairs = [(one, other) for one, other in _USUAL if one in sizes]
    return {f"{one} to {other}": sizes[one] / max(sizes[other], 1e-9) for one, other in pairs}


def crossing_shares(template: Template) -> dict[str, float]:
    """How far along its limb from a joint the weights of the bones on both sides are equal.

    Elbows and knees in lengths of the whole limb, shoulders and hips in lengths of its first bone;
    joints where too few edges show it are left out.
    """
    at = joint_places(template)
    edges = _edges(template)
    found = {}
    for side in "lr":
        for joint, end in _AXES.items():
            name = f"{side}_{joint}"
            places = _crossings(template, name, edges)
            if len(places) >= _CROSSINGS:
                along = at[f"{side}_{end}"] - at[f"{side}_{_ABOVE.get(joint, joint)}"]
                square = max(float(along @ along), 1e-9)
                found[name] = float(np.median((places - at[name]) @ along)) / square
    return found


def _proportions(template: Template) -> Iterator[Finding]:
    """Lengths, of both sides alike, that people do not have."""
    odd = []
    usual = {f"{one} to {other}": ends for (one, other), ends in _USUAL.items()}
    for name, ratio in proportions(template).items():
        low, high = usual[name]
        if not low <= ratio <= high:
            odd.append(f"the length of {name} is {ratio:.2f}, of people {low} to {high}")
    if odd:
        remedy = "put the bones at the joints, unless the character is drawn so"
        yield Finding(Severity.WARNING, "limbs", "; ".join(odd), remedy)


def _bends(template: Template) -> Iterator[Finding]:
    """Joints that lie far from where the weights of the bones on both sides are equal."""
    at = joint_places(template)
    odd = []
    for name, share in crossing_shares(template).items():
        side, joint = name.split("_")
        low, high = _ALONG[joint]
        if not low <= share <= high:
            along = at[f"{side}_{_AXES[joint]}"] - at[f"{side}_{_ABOVE.get(joint, joint)}"]
            odd.append(f"{name} by {100 * abs(share) * float(np.linalg.norm(along)):.0f} cm")
    if odd:
        what = f"joints lie aside of where the skin's weights change bones: {', '.join(odd)}"
        remedy = (
            "put the bones at the joints, or paint the weights anew; bodies that perfcap makes of "
            "unusual measures may be so"
        )
        yield Finding(Severity.WARNING, "limbs", what, remedy)


def _edges(template: Template) -> NDArray[np.int64]:
    """Pairs of vertices of triangles, (E, 2), each once."""
    sides = np.stack((template.faces, np.roll(template.faces, -1, 1)), -1).reshape(-1, 2)
    edges: NDArray[np.int64] = np.unique(np.sort(sides, 1), axis=0)
    return edges


def _crossings(template: Template, joint: str, edges: NDArray[np.int64]) -> Floats:
    """Places (N, 3) on edges where a joint's weight and that of what it hangs on are equal.

    They are linear along edges. What elbows and knees hang on is the limb's other bone; shoulders
    and hips, all but the limb.
    """
    side, place = joint.split("_")
    below = _mass(template, joint)
    if place in _ABOVE:
        other = _mass(template, f"{side}_{_ABOVE[place]}")
    else:
        other = 1 - below - sum(_mass(template, f"{side}_{name}") for name in _BELOW[place])
    start, end = edges.T
    excess = other - below
    crossed = (excess[start] > 0) != (excess[end] > 0)
    start, end = start[crossed], end[crossed]
    share = (excess[start] / (excess[start] - excess[end]))[:, None]
    both = (below + other)[:, None]
    theirs = ((1 - share) * both[start] + share * both[end])[:, 0] > 0.5
    places = (1 - share) * template.vertices[start] + share * template.vertices[end]
    found: Floats = places[theirs]
    return found


def _mass(template: Template, joint: str) -> Floats:
    """Share of the vertices (V,) that a joint's bone and its helpers move."""
    own = np.isin(template.weight_bones, [*carried_by(template, template.joint_bones[joint])])
    mass: Floats = np.where(own, template.weights, 0).sum(1)
    return mass
