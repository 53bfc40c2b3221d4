"""Which of a rig's bones are the joints of the skeleton, where it ends, and which side is left.

What a user says comes first, then what names say, then what the tree and the rest pose say.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_correction import GIVEN_AS
from perfcap.actor.bone_geometry import match_places
from perfcap.actor.bone_names import ENDS, NAMED, SIDED, NameMatch, match_names
from perfcap.actor.template import Template
from perfcap.errors import InputError

# --- Which side of a body is the left one: the one on the left of where the feet point ------------

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


# --- Which of a rig's bones are the joints of the skeleton ----------------------------------------

GIVEN, NAME, PLACE = "mapping", "name", "place"
_ENOUGH = 8  # joints that names must tell before they are believed
_CHEST = 0.65  # of the way from the pelvis to the neck: where the trunk bends
_LIMB = (0.25, 4.0)  # length of a limb's upper bone over its lower one


@dataclass(frozen=True)
class BoneMap:
    """Bones by joint.

    Attributes:
        convention: whose names they are; None where too few names are known.
        joints: bone of each of the 16 joints.
        ends: bones that begin at head_top, l_toe or r_toe, where there are any.
        sources: how each joint was found: ``mapping``, ``name`` or ``place``.
        swapped: whether the bones that names call left are on the right, and were exchanged.
    """

    convention: str | None
    joints: Mapping[str, int]
    ends: Mapping[str, int]
    sources: Mapping[str, str]
    swapped: bool = False


def map_bones(template: Template, given: Mapping[str, str] | None = None) -> BoneMap:
    """Find the joints among the bones of a rig, in any units and with any axis up.

    Args:
        template: the rigged mesh.
        given: names of bones by joint or landmark, which are taken as they are.

    Raises:
        InputError: a joint has no bone, or a given name is wrong.
    """
    chosen = _given(template, given or {})
    names = match_names(template.bone_names, _moved(template))
    known = len(names.joints) >= _ENOUGH and _plausible(template, names)
    found = dict(names.joints) if known else {}
    sources = dict.fromkeys(found, NAME)
    places = None
    if any(name not in found and name not in chosen for name in NAMED):
        places = _placed(template, found)
        if _shared({**places, **found}) and not _shared(places) and set(NAMED) <= places.keys():
            found, sources = {}, {}  # such as of a `leg` above a `shin`, which else is the knee
        sources = {**dict.fromkeys(places, PLACE), **sources}
        found = {**places, **found}
    ends = dict(names.ends) if known else {}
    swapped = False
    if not any(name[:2] in ("l_", "r_") for name in chosen):
        swapped = facing(template, found) < -SURE
    if swapped:
        found, ends = exchanged(found), exchanged(ends)
    joints = {**found, **{n: b for n, b in chosen.items() if n in JOINTS}}
    ends |= {n: b for n, b in chosen.items() if n in ENDS}
    _require(template, joints, NAMED)
    if "spine" not in joints:
        joints["spine"] = _spine(template, joints)
        sources["spine"] = PLACE
    _require_distinct(template, joints)
    sources |= dict.fromkeys((n for n in chosen if n in JOINTS), GIVEN)
    return BoneMap(
        names.convention if known else None,
        {name: joints[name] for name in JOINTS},
        ends,
        {name: sources[name] for name in JOINTS},
        swapped and known,
    )


def _given(template: Template, given: Mapping[str, str]) -> dict[str, int]:
    """Bones of given names."""
    unknown = [name for name in given if name not in (*JOINTS, *ENDS)]
    if unknown:
        raise InputError(
            f"mapping: {', '.join(unknown)} is no joint; expected some of "
            f"{', '.join((*JOINTS, *ENDS))}"
        )
    for joint, name in given.items():
        if name not in template.bone_names:
            near = difflib.get_close_matches(name, template.bone_names, 3, 0.5)
            hint = f"; similar are {', '.join(near)}" if near else ""
            raise InputError(
                f"mapping: {joint} is {name!r}, but actor {template.name!r} has no bone of that "
                f"name{hint}; `perfcap actor inspect` lists them"
            )
    return {joint: template.bone_names.index(name) for joint, name in given.items()}


def _moved(template: Template) -> Floats:
    moved = np.zeros(len(template.bone_names))
    np.add.at(moved, template.weight_bones, template.weights)
    return moved


def _plausible(template: Template, names: NameMatch) -> bool:
    """Whether limbs have the lengths of limbs: names may mean other bones than usual."""
    at = {name: template.bone_rest[bone, :3, 3] for name, bone in names.joints.items()}
    for side in "lr":
        for limb in (SIDED[:3], SIDED[3:]):
            if not all(f"{side}_{part}" in at for part in limb):
                continue
            start, middle, end = (at[f"{side}_{part}"] for part in limb)
            lower = float(np.linalg.norm(end - middle))
            if lower <= 0 or not _LIMB[0] < np.linalg.norm(middle - start) / lower < _LIMB[1]:
                return False
    return True


def _placed(template: Template, found: Mapping[str, int]) -> dict[str, int]:
    """Joints by their places, sides as the names have them where names are known."""
    match = match_places(template)
    if match is None:
        return {}
    joints = dict(match.joints)
    other = exchanged(joints)
    if found:
        same, opposite = (sum(m[n] == b for n, b in found.items() if n in m)
                          for m in (joints, other))  # fmt: skip
        return joints if same >= opposite else other
    cosine = facing(template, joints)
    if abs(cosine) < SURE:
        raise InputError(
            f"actor {template.name!r}: its feet do not tell left from right, and its bones have no "
            f"known names; name them in a mapping file and give it as {GIVEN_AS}"
        )
    return joints if cosine > 0 else other


def _spine(template: Template, joints: Mapping[str, int]) -> int:
    """The bone between pelvis and neck at which the trunk bends."""
    parents = template.bone_parents
    between = [
        bone for bone in _above(parents, joints["neck"])
        if bone not in {joints["pelvis"], *_above(parents, joints["pelvis"])}
    ]  # fmt: skip
    arms = [set(_above(parents, joints[f"{side}_shoulder"])) for side in "lr"]
    holding = [bone for bone in between if all(bone in arm for arm in arms)] or between
    holding = [bone for bone in holding if bone not in joints.values()]
    if not holding:
        raise InputError(
            f"actor {template.name!r}: no bone for spine, because none is between "
            f"{template.bone_names[joints['pelvis']]} (pelvis) and "
            f"{template.bone_names[joints['neck']]} (neck); add one in Blender, or name another "
            f"pelvis or neck in a mapping file and give it as {GIVEN_AS}"
        )
    places = template.bone_rest[:, :3, 3]
    start, way = places[joints["pelvis"]], places[joints["neck"]] - places[joints["pelvis"]]
    share = (places[holding] - start) @ way / max(float(way @ way), 1e-12)
    return holding[int(np.abs(share - _CHEST).argmin())]


def _above(parents: NDArray[np.int64], bone: int) -> list[int]:
    """Ancestors of a bone, nearest first."""
    chain = []
    while (bone := int(parents[bone])) >= 0:
        chain.append(bone)
    return chain


def _require(template: Template, joints: Mapping[str, int], names: Sequence[str]) -> None:
    missing = [name for name in names if name not in joints]
    if missing:
        bones = ", ".join(template.bone_names[:12])
        more = ", ..." if len(template.bone_names) > 12 else ""
        raise InputError(
            f"actor {template.name!r}: no bone found for {', '.join(missing)} among {bones}{more}; "
            f'write lines like {missing[0]} = "name of the bone" into a file and give it as '
            f"{GIVEN_AS}"
        )


def _require_distinct(template: Template, joints: Mapping[str, int]) -> None:
    for bone, names in _shared(joints).items():
        raise InputError(
            f"actor {template.name!r}: bone {template.bone_names[bone]} is {', '.join(names)}; "
            f"expected a bone for each: name another one in a mapping file, given as {GIVEN_AS}"
        )


def _shared(joints: Mapping[str, int]) -> dict[int, list[str]]:
    """Bones that are more than one joint, and which."""
    by_bone: dict[int, list[str]] = {}
    for name, bone in joints.items():
        by_bone.setdefault(bone, []).append(name)
    return {bone: names for bone, names in by_bone.items() if len(names) > 1}


# --- Landmarks beyond the last joints: the top of the head and the toes ---------------------------

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
