"""Names of many programs in one form."""

import numpy as np
import pytest
from foreign_rigs import BIPED, MIXAMO, RIGIFY, UNREAL, VRM

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.bone_names import CONVENTIONS, NAMED, match_names, normal_form


@pytest.mark.parametrize(
    ("name", "side", "words"),
    [
        ("mixamorig:LeftForeArm", "l", "forearm"),
        ("mixamorig1:Hips", "", "hips"),
        ("mixamorigRightUpLeg", "r", "upleg"),
        ("Left Forearm", "l", "forearm"),
        ("forearm.L", "l", "forearm"),
        ("thigh.L.001", "l", "thigh1"),
        ("DEF-spine.003", "", "spine3"),
        ("lShldr", "l", "shldr"),
        ("J_Bip_L_UpperArm", "l", "upperarm"),
        ("J_Bip_C_Hips", "", "hips"),
        ("CC_Base_NeckTwist01", "", "necktwist1"),
        ("Bip001 R Toe0Nub", "r", "toe0nub"),
        ("leftupperarm", "l", "upperarm"),
        ("LHipJoint", "l", "hipjoint"),
        ("Armature|root", "", "root"),
        ("RightToeBase", "r", "toebase"),
        ("l_shoulder", "l", "shoulder"),
        ("upperarm01.R", "r", "upperarm1"),
        ("bone", "", ""),
        ("", "", ""),
        ("骨", "", ""),
    ],
)
def test_names_lose_their_program(name: str, side: str, words: str) -> None:
    assert normal_form(name) == (side, words)


@pytest.mark.parametrize(
    ("names", "convention"),
    [
        (MIXAMO, "Mixamo"),
        (BIPED, "Biped"),
        (UNREAL, "Unreal and game engine"),
        (VRM, "VRM and Unity"),
        (RIGIFY, "Rigify"),
        ({joint: joint for joint in (*JOINTS, "l_toe")}, "perfcap"),
    ],
)
def test_conventions_are_told_apart(names: dict[str, str], convention: str) -> None:
    bones = [*names.values(), "hair_01", "weapon_r"]
    match = match_names(bones, np.ones(len(bones)))
    assert match.convention == convention
    assert {joint: bones[bone] for joint, bone in match.joints.items()} == {
        joint: names[joint] for joint in NAMED
    }


def test_of_two_layers_the_one_with_skin_is_meant() -> None:
    bones = [f"{layer}-{name}" for layer in ("ORG", "DEF", "MCH") for name in ("thigh.L", "spine")]
    match = match_names(bones, np.array([0, 0, 3.0, 2.0, 0, 0]))
    assert match.joints == {"pelvis": 3, "l_hip": 2}


def test_rows_are_in_normal_form() -> None:
    for row in CONVENTIONS:
        for words in row[1:]:
            for word in words.split():
                assert normal_form(f"{word}_l") == ("l", word)
