"""Bones to joints: by what is given, by names, by places."""

from dataclasses import replace

import numpy as np
import pytest
from foreign_rigs import MIXAMO, NAMELESS, RIGS, UNREAL, Rig, person, transformed
from scipy.spatial.transform import Rotation

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_geometry import match_places
from perfcap.actor.bone_map import exchanged, facing, map_bones
from perfcap.actor.template import Template
from perfcap.errors import InputError


def named(template: Template, joints: dict[str, int]) -> dict[str, str]:
    return {joint: template.bone_names[bone] for joint, bone in joints.items()}


@pytest.mark.parametrize("rig", [r for r in RIGS.values() if not r.loose], ids=lambda r: r.unit)
def test_places_alone_tell_joints(rig: Rig) -> None:
    template = rig.template()
    template = replace(
        template, bone_names=tuple(f"bone_{n}" for n in range(len(template.bone_names)))
    )
    expected = [rig.template().bone_names.index(rig.names[joint]) for joint in JOINTS]
    found = map_bones(template)
    places = template.bone_rest[:, :3, 3]
    apart = places[[found.joints[joint] for joint in JOINTS]] - places[expected]
    # helpers of the face may be a little nearer to where a head usually turns
    assert np.linalg.norm(apart, axis=1).max() < (0.05 if rig.extra else 1e-9)
    assert found.convention is None and set(found.sources.values()) == {"place"}
    assert not found.swapped


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_any_axis_may_be_up(axis: int, sign: int) -> None:
    up = sign * np.eye(3)[axis]
    turn = np.stack((np.eye(3)[axis - 2], up, np.cross(np.eye(3)[axis - 2], up)), 1)
    template = transformed(Rig(NAMELESS).template(), 37 * turn, np.array([5.0, -3.0, 70.0]))
    match = match_places(template)
    assert match is not None
    np.testing.assert_array_equal(match.up, up)
    assert named(template, dict(map_bones(template).joints)) == NAMELESS


def test_small_leans_do_not_matter() -> None:
    turn = Rotation.from_euler("xyz", (8, 35, -6), degrees=True).as_matrix()
    template = transformed(Rig(NAMELESS).template(), turn, np.zeros(3))
    assert named(template, dict(map_bones(template).joints)) == NAMELESS


def test_a_few_unknown_names_are_found_by_places() -> None:
    names = MIXAMO | {"neck": "Nacken", "l_wrist": "Hand links"}
    template = Rig(names, spines=("mixamorig:Spine",)).template()
    found = map_bones(template)
    assert named(template, dict(found.joints)) == names
    assert found.sources["neck"] == found.sources["l_wrist"] == "place"
    assert found.sources["r_wrist"] == "name" and found.convention == "Mixamo"


def test_names_of_other_bones_than_usual_are_not_believed() -> None:
    """A rig that calls a calf a thigh, and has a helper at the knee that is called calf."""
    template = Rig(UNREAL).template()
    swap = {"thigh_l": "hip_l", "calf_l": "thigh_l"}
    names = tuple(swap.get(name, name) for name in template.bone_names)
    place = template.bone_rest[template.bone("calf_l")].copy()
    place[:3, 3] += 1e-3
    template = replace(
        template,
        bone_names=(*names, "calf_l"),
        bone_parents=np.append(template.bone_parents, names.index("thigh_l")),
        bone_rest=np.concatenate((template.bone_rest, place[None])),
    )
    found = map_bones(template)
    assert template.bone_names[found.joints["l_knee"]] == "thigh_l"


ARMS = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")
TRUNK = {"pelvis": "hips", "spine": "chest", "neck": "neck", "head": "head"}


@pytest.mark.parametrize(
    ("collar", "arm", "leg"),
    [
        ("shoulder", "arm forearm hand", "leg shin foot"),
        (None, "arm forearm hand", "leg calf foot"),
        ("shoulder", "arm elbow wrist", "leg knee ankle"),
        ("collar", "shoulder arm hand", "thigh shin foot"),
        ("shoulder", "arm_upper arm_lower hand", "leg_upper leg_lower foot"),
        ("shoulder", "bicep forearm hand", "thigh calf foot"),
        (None, "upper_arm arm hand", "upper_leg leg foot"),
    ],
)
def test_words_that_mean_a_limb_or_a_part_of_it(collar: str | None, arm: str, leg: str) -> None:
    """`leg` is a thigh above a shin, and a shank below an upper leg; `shoulder` may be a collar."""
    words = [*zip(ARMS[0], arm.split(), strict=True), *zip(ARMS[1], leg.split(), strict=True)]
    names = TRUNK | {f"{side}_{joint}": f"{word}.{side}" for joint, word in words for side in "lr"}
    template = Rig(names, collar=collar).template()
    found = map_bones(template)
    assert named(template, dict(found.joints)) == names


def test_what_is_given_comes_first() -> None:
    template = Rig(MIXAMO, spines=("mixamorig:Spine",)).template()
    found = map_bones(template, {"spine": "mixamorig:Spine", "head_top": "mixamorig:Head"})
    assert found.sources["spine"] == "mapping"
    assert template.bone_names[found.joints["spine"]] == "mixamorig:Spine"
    assert template.bone_names[found.ends["head_top"]] == "mixamorig:Head"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"hand": "x"}, "hand is no joint"),
        ({"l_wrist": "mixamorig:LeftHnad"}, "similar are mixamorig:LeftHand"),
        ({"l_wrist": "mixamorig:LeftFoot"}, "is l_wrist, l_ankle"),
    ],
)
def test_a_wrong_mapping_is_refused(given: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        map_bones(Rig(MIXAMO).template(), given)


def test_what_is_missing_is_named() -> None:
    plain = person()
    template = replace(
        plain,
        bone_names=("Hips", "Torso", *(f"part {n}" for n in range(14))),
        weight_bones=np.zeros_like(plain.weight_bones),
    )
    with pytest.raises(InputError, match=r"no bone found for pelvis, .*--mapping") as caught:
        map_bones(template)
    assert "Torso" in str(caught.value) and "\n" not in str(caught.value)


def test_a_trunk_of_one_bone_is_refused() -> None:
    template = Rig(MIXAMO).template()
    bone = template.bone("mixamorig:Spine2")
    parents = np.where(template.bone_parents == bone, 0, template.bone_parents)
    names = tuple("x" if n == "mixamorig:Spine2" else n for n in template.bone_names)
    with pytest.raises(InputError, match="no bone for spine"):
        map_bones(replace(template, bone_parents=parents, bone_names=names))


def test_feet_tell_left_from_right() -> None:
    template = person()
    joints = {name: template.bone(name) for name in JOINTS}
    assert facing(template, joints) > 0.9
    assert facing(template, exchanged(joints)) < -0.9
    assert exchanged(exchanged(joints)) == joints
    assert facing(template, {"pelvis": 0}) == 0
