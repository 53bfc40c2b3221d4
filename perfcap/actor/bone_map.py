"""Which of a rig's bones are the joints of the skeleton.

What a user says comes first, then what names say, then what the tree and the rest pose say.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_geometry import match_places
from perfcap.actor.bone_names import ENDS, NAMED, SIDED, NameMatch, match_names
from perfcap.actor.bone_sides import SURE, exchanged, facing
from perfcap.actor.template import Template
from perfcap.errors import InputError

Floats = NDArray[np.float64]

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
            "known names; name them in a mapping file and give it as --mapping"
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
            "pelvis or neck in a mapping file and give it as --mapping"
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
            "--mapping"
        )


def _require_distinct(template: Template, joints: Mapping[str, int]) -> None:
    by_bone: dict[int, list[str]] = {}
    for name, bone in joints.items():
        by_bone.setdefault(bone, []).append(name)
    for bone, names in by_bone.items():
        if len(names) > 1:
            raise InputError(
                f"actor {template.name!r}: bone {template.bone_names[bone]} is {', '.join(names)}; "
                "expected a bone for each: name another one in a mapping file (--mapping)"
            )
