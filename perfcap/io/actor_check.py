"""What is wrong with an actor, before anybody captures with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_correction import SHORTEST, TALLEST
from perfcap.actor.bone_map import SURE, facing
from perfcap.actor.template import Template
from perfcap.geometry.surface_topology import SurfaceTopology, face_areas, surface_topology
from perfcap.io.actor_limbs import LIMBS, carried_by, joint_places, limb_findings
from perfcap.io.actor_points import landmark_findings
from perfcap.io.doctor.finding import Finding, Severity

Floats = NDArray[np.float64]

_TRUNK = (("pelvis", "spine"), ("spine", "neck"), ("neck", "head"))
LEANING = 30.0  # degrees, of the trunk: more is no rest pose
SEATED, CROUCHED, RAISED, _HANGING = 50.0, 60.0, 130.0, 12.0  # thighs, knees, arms
_INSIDE = 0.3  # winding number of a place within the body; 1 in a closed surface
_TREE_BONES, _TREE_HEIGHT = 12, 0.6  # of a skeleton that is a person's
_ASIDE, _NEARER = 0.06, 0.5  # of the height, and of the way to a bone, that its flesh is elsewhere
_BEYOND = 0.1  # of the height: hands and heads
_INWARDS = 0.1  # a sphere has 1, a flat sheet 0
_SMALL_PIECE = 0.01  # share of the area below which a piece is not looked at
_FACES_AT_ONCE = 4096


def examine_actor(template: Template) -> tuple[Finding, ...]:
    """Findings about a template in metres whose joints are known, or bones are called like them."""
    topology = surface_topology(template.vertices, template.faces)
    template = _joined(template)
    return (
        *_size(template),
        *examine_joints(template),
        *_people(template),
        *(_skin(template) if _has_joints(template) else ()),
        *examine_weights(template),
        *_surface(template, topology),
        *_inside_out(template, topology),
        *_outside(template, topology),
    )


def examine_joints(template: Template) -> tuple[Finding, ...]:
    """Findings about the joints, landmarks and rest pose of a template in metres alone.

    None of a skeleton that lacks joints of a person.
    """
    template = _joined(template)
    if not _has_joints(template):
        return ()
    return (
        *_chains(template),
        *_sides(template),
        *limb_findings(template),
        *landmark_findings(template),
        *_pose(template),
    )


def _joined(template: Template) -> Template:
    """The same with its joints by name, where bones are called like them."""
    named = {name: bone for bone, name in enumerate(template.bone_names) if name in JOINTS}
    return template if template.joint_bones else replace(template, joint_bones=named)


def _has_joints(template: Template) -> bool:
    return template.joint_bones.keys() == set(JOINTS)


def _size(template: Template) -> Iterator[Finding]:
    height = float(np.ptp(template.vertices[:, 1]))
    if not SHORTEST <= height <= TALLEST:
        what = f"is {height:.2f} m tall, a grown person {SHORTEST} to {TALLEST} m"
        remedy = "state metres_per_unit in a mapping file if that is wrong"
        yield Finding(Severity.WARNING, "scale", what, remedy)


def _chains(template: Template) -> Iterator[Finding]:
    """Limbs and necks whose bones hang the other way round, or on the other side."""
    bones, parents = template.joint_bones, template.bone_parents

    def below(bone: int, above: int) -> bool:
        while bone >= 0 and bone != above:
            bone = int(parents[bone])
        return bone == above

    links: list[tuple[str, str, str | None]] = [(*pair, None) for pair in _TRUNK]
    for side, other in ("lr", "rl"):
        links += [(f"{side}_{up}", f"{side}_{down}", f"{other}_{up}") for up, down in LIMBS]
    for upper, lower, across in links:
        own, end = bones[upper], bones[lower]
        crossed = below(own, end) or (across is not None and below(end, bones[across]))
        if crossed and not below(end, own):
            names = template.bone_names
            what = (
                f"{lower} is the bone {names[end]}, which does not hang on {names[own]}, the bone "
                f"of {upper}"
            )
            subject = "trunk" if across is None else "limbs"
            yield Finding(Severity.ERROR, subject, what, "name the right bones in a mapping file")


def _sides(template: Template) -> Iterator[Finding]:
    """Shoulders that are on the other side than the hips: of the arms alone, or the legs."""
    at = joint_places(template)
    if float((at["l_shoulder"] - at["r_shoulder"]) @ (at["l_hip"] - at["r_hip"])) < 0:
        what = "l_shoulder is on the side of r_hip, and r_shoulder on that of l_hip"
        remedy = "exchange l_ and r_ of the arms, or of the legs, in a mapping file"
        yield Finding(Severity.ERROR, "left and right", what, remedy)
    elif facing(template, template.joint_bones) < -SURE:
        what = "joints called left are on the right of where the feet point"
        remedy = (
            "exchange l_ and r_ in the mapping file, or [joints] of manifest.toml; of a scan, take "
            "away all but the person, whose feet are needed"
        )
        yield Finding(Severity.ERROR, "left and right", what, remedy)


def _pose(template: Template) -> Iterator[Finding]:
    """A rest pose from which nobody can be posed well."""
    at = joint_places(template)
    up = np.array([0.0, 1.0, 0.0])
    angles = {"trunk": (_angle(at["neck"] - at["pelvis"], up), 0.0, LEANING, "leans by")}
    for side in "lr":
        thigh, shank, arm = (
            at[f"{side}_{end}"] - at[f"{side}_{start}"]
            for start, end in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"))
        )
        angles |= {
            f"{side}_hip": (_angle(thigh, -up), 0.0, SEATED, "is bent by"),
            f"{side}_knee": (_angle(shank, thigh), 0.0, CROUCHED, "is bent by"),
            f"{side}_shoulder": (_angle(arm, -up), _HANGING, RAISED, "is lifted by"),
        }
    for name, (angle, low, high, verb) in angles.items():
        if angle > high:
            what = f"{name} {verb} {angle:.0f} degrees in the rest pose, which is far from T or A"
            remedy = "export the character in a T- or A-pose"
            yield Finding(Severity.ERROR, "rest pose", what, remedy)
        elif angle < low:
            what = f"{name} {verb} {angle:.0f} degrees only: armpits will deform badly"
            yield Finding(Severity.WARNING, "rest pose", what, "prefer an A-pose")


def _angle(one: Floats, other: Floats) -> float:
    length = float(np.linalg.norm(one) * np.linalg.norm(other))
    cosine = float(one @ other) / length if length > 0 else 1.0
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _people(template: Template) -> Iterator[Finding]:
    """Several skeletons, each as tall as a person."""
    root = np.arange(len(template.bone_names))
    for bone, parent in enumerate(template.bone_parents.tolist()):
        root[bone] = bone if parent < 0 else root[parent]
    used = np.zeros(len(root), dtype=np.bool_)
    used[np.unique(template.weight_bones[template.weights > 0])] = True
    heights = template.bone_rest[:, 1, 3]
    least = _TREE_HEIGHT * float(np.ptp(template.vertices[:, 1]))
    trees = [used & (root == each) for each in np.unique(root)]
    people = [tree for tree in trees if tree.sum() >= _TREE_BONES and np.ptp(heights[tree]) > least]
    if len(people) > 1:
        names = ", ".join(template.bone_names[int(root[tree][0])] for tree in people)
        what = f"holds {len(people)} skeletons of people, with the roots {names}"
        yield Finding(Severity.ERROR, "skeleton", what, "export one person a file")


def _skin(template: Template) -> Iterator[Finding]:
    moved = np.zeros(len(template.bone_names))
    np.add.at(moved, template.weight_bones, template.weights)
    used = {JOINTS.index(name): moved[bone] for name, bone in template.joint_bones.items()}
    still = [JOINTS[joint] for joint, mass in used.items() if mass <= 0]
    # helpers below a joint may carry its skin
    still = [name for name in still if not _below(template, template.joint_bones[name], moved)]
    if still:
        what = f"{', '.join(still)} move no vertex"
        yield Finding(Severity.WARNING, "weights", what, "paint them, or map other bones")
    loose = len(template.vertices) - len(np.unique(template.faces))
    if loose:
        yield Finding(Severity.INFO, "mesh", f"{loose} vertices belong to no triangle")
    if template.texture is None:
        yield Finding(Severity.INFO, "texture", "there is none; the actor is drawn grey")


def _below(template: Template, bone: int, moved: Floats) -> bool:
    """Whether a bone, or those that hang on it, joints excepted, move anything."""
    return any(moved[each] > 0 for each in carried_by(template, bone))


def examine_weights(template: Template) -> Iterator[Finding]:
    """Limbs that move what lies about another one: their weights hang on the wrong bones.

    None of a skeleton that lacks joints of a person.
    """
    template = _joined(template)
    if not _has_joints(template):
        return
    at = joint_places(template)
    height = float(np.ptp(template.vertices[:, 1]))
    limbs = _limbs(at, height)
    starts, ends = (np.array([limb[end] for limb in limbs.values()]) for end in (0, 1))
    wrong = []
    for place, name in enumerate(limbs):
        own = np.isin(template.weight_bones, [*carried_by(template, template.joint_bones[name])])
        mass = np.where(own, template.weights, 0).sum(1)
        if mass.sum() > 0:
            middle = mass @ template.vertices / mass.sum()
            apart = _from_segments(middle, starts, ends)
            nearest = int(apart.argmin())
            if apart[place] > _ASIDE * height and apart[nearest] < _NEARER * apart[place]:
                wrong.append(f"{name} moves what lies about {list(limbs)[nearest]}")
    if wrong:
        remedy = "paint the weights anew, or name the right bones in a mapping file"
        yield Finding(Severity.WARNING, "weights", "; ".join(wrong), remedy)


def _limbs(at: Mapping[str, Floats], height: float) -> dict[str, tuple[Floats, Floats]]:
    """Where the flesh of a joint's bone lies: along the bone, and beyond the last ones."""
    beyond = _BEYOND * height
    crown = at["head"] + [0.0, beyond, 0.0]
    found = {"spine": (at["spine"], at["neck"]), "head": (at["head"], crown)}
    for side in "lr":
        names = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
        shoulder, elbow, wrist, hip, knee, ankle = (at[f"{side}_{name}"] for name in names)
        hand = (wrist - elbow) / max(float(np.linalg.norm(wrist - elbow)), 1e-9)
        ends = (elbow, wrist, wrist + beyond * hand, knee, ankle, ankle)
        starts = (shoulder, elbow, wrist, hip, knee, ankle)
        pairs = zip(starts, ends, strict=True)
        found |= {f"{side}_{name}": pair for name, pair in zip(names, pairs, strict=True)}
    return found


def _from_segments(point: Floats, starts: Floats, ends: Floats) -> Floats:
    """Distances of a point (3,) from segments (N, 3) to (N, 3), (N,)."""
    along = ends - starts
    share = ((point - starts) * along).sum(1) / np.maximum((along**2).sum(1), 1e-12)
    distance: Floats = np.linalg.norm(starts + share.clip(0, 1)[:, None] * along - point, axis=1)
    return distance


def _surface(template: Template, topology: SurfaceTopology) -> Iterator[Finding]:
    folded = int(topology.non_manifold.sum())
    if folded:
        what = f"more than two triangles meet in {folded} edges"
        yield Finding(Severity.WARNING, "mesh", what, "separate the sheets, or leave them")
    rims = int(topology.boundary_loops().max(initial=-1)) + 1
    if rims:
        edges = int(topology.boundary.sum())
        what = f"{rims} holes or hems with {edges} open edges, in {topology.components} pieces"
        yield Finding(Severity.INFO, "mesh", what)
    flat = int((face_areas(template.vertices, template.faces) <= 0).sum())
    if flat:
        yield Finding(Severity.INFO, "mesh", f"{flat} triangles have no area")


def _inside_out(template: Template, topology: SurfaceTopology) -> Iterator[Finding]:
    """Pieces whose triangles face inwards, and neighbours that face opposite ways."""
    places = template.vertices[topology.representative]
    corners = places[topology.faces]
    piece = topology.component[topology.faces[:, 0]]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    size = np.linalg.norm(area, axis=1)
    total = np.bincount(piece, size)
    middle = (
        np.stack([np.bincount(piece, size * corners.mean(1)[:, axis]) for axis in range(3)], 1)
        / np.maximum(total, 1e-12)[:, None]
    )
    outwards = corners.mean(1) - middle[piece]
    volume = np.bincount(piece, (outwards * area).sum(1))
    bulk = np.bincount(piece, size * np.linalg.norm(outwards, axis=1))
    wrong = (volume < -_INWARDS * bulk) & (total > _SMALL_PIECE * total.sum())
    if wrong.any():
        share = 100 * total[wrong].sum() / total.sum()
        what = f"{int(wrong.sum())} pieces ({share:.0f} % of the area) are inside out"
        yield Finding(Severity.WARNING, "faces", what, "flip their normals in Blender")
    sides = np.stack((topology.faces, np.roll(topology.faces, -1, 1)), -1).reshape(-1, 2)
    _, uses = np.unique(sides[:, 0] * topology.places + sides[:, 1], return_counts=True)
    torn = int((uses > 1).sum())
    if torn > int(topology.non_manifold.sum()) * 2:
        what = f"neighbouring triangles face opposite ways along {torn} edges"
        yield Finding(Severity.WARNING, "faces", what, "recalculate normals in Blender")


def _outside(template: Template, topology: SurfaceTopology) -> Iterator[Finding]:
    names = list(template.joint_bones)
    points = template.bone_rest[[template.joint_bones[n] for n in names], :3, 3]
    corners = template.vertices[topology.representative][topology.faces]
    winding = np.abs(winding_numbers(points, corners))
    out = [name for name, value in zip(names, winding, strict=True) if value < _INSIDE]
    if out:
        what = f"{', '.join(out)} lie outside the mesh"
        remedy = "check the mapping, or that skeleton and mesh have the same scale"
        yield Finding(Severity.WARNING, "joints", what, remedy)


def winding_numbers(points: Floats, corners: Floats) -> Floats:
    """How often a surface of triangles (T, 3, 3) surrounds points (N, 3) (Jacobson et al. 2013).

    One inside a closed surface, zero outside; in between near holes.
    """
    total = np.zeros(len(points))
    for start in range(0, len(corners), _FACES_AT_ONCE):
        a, b, c = (corners[None, start : start + _FACES_AT_ONCE, k] - points[:, None]
                   for k in range(3))  # fmt: skip
        la, lb, lc = (np.linalg.norm(each, axis=-1) for each in (a, b, c))
        triple = (a * np.cross(b, c)).sum(-1)
        rest = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        total += np.arctan2(triple, rest).sum(1) / (2 * np.pi)
    return total
