"""Characters of other programs: captured, exported, and played on their own bones again."""

from pathlib import Path

import numpy as np
import pytest
import torch
from foreign_rigs import BIPED, MIXAMO, RIGS, UNREAL, Rig, person, played_on, transformed
from takes import sway

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.skin_weights import SkinWeights
from perfcap.actor.skinning import dual_quaternion_blend, linear_blend
from perfcap.errors import InputError
from perfcap.io.actor import load_actor
from perfcap.io.actor_import import ActorMapping, ImportedActor, import_actor, require_sound
from perfcap.io.bvh_read import bvh_motion, joint_positions, load_bvh
from perfcap.io.bvh_write import save_bvh
from perfcap.io.doctor import Severity
from perfcap.io.gltf_animation import read_bone_transforms
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import read_template
from perfcap.io.gltf_write import save_animation

FRAMES, RATE = 30, 30.0
TENTH_MM = 1e-4


@pytest.fixture(scope="module", params=RIGS)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple:
    """A rig, its file, and what the import makes of it."""
    path = tmp_path_factory.mktemp("rig") / "own.glb"
    rig = RIGS[request.param]
    rig.write(path)
    return rig, path, import_actor(path)


def exported(found: ImportedActor, path: Path) -> tuple:
    """A second of motion, and the bones' transforms in it, written as a capture is."""
    motion = sway(found.actor, FRAMES, RATE)
    transforms = found.actor.bone_transforms(motion)
    save_animation(path, found.actor.template, transforms.numpy(), RATE)
    return motion, transforms


def test_joints_are_found_where_they_are(case: tuple) -> None:
    rig, _, found = case
    names = {joint: found.actor.template.bone_names[b] for joint, b in found.bones.joints.items()}
    assert names == dict(rig.names)
    rest = person().bone_rest[:, :3, 3]
    offset = found.actor.skeleton.rest_positions[0].numpy() - rest[0]
    places = found.actor.skeleton.rest_positions.numpy() - offset * [1, 0, 1]
    np.testing.assert_allclose(places, rest, atol=2e-6)


def test_scale_and_axes_are_put_right(case: tuple) -> None:
    rig, _, found = case
    lies = not rig.armature
    assert found.correction.scale == (rig.unit if lies else 1.0)
    expected = rig.turn.T if lies else np.eye(3)
    np.testing.assert_array_equal(found.correction.rotation, expected)
    subjects = {finding.subject for finding in found.about_file}
    assert ("scale" in subjects) == (found.correction.scale != 1)
    assert ("axes" in subjects) == (lies and not np.array_equal(rig.turn, np.eye(3)))
    assert not any(finding.severity is Severity.ERROR for finding in found.findings)


def test_a_second_of_motion_survives_export_and_import(case: tuple, tmp_path: Path) -> None:
    _, _, found = case
    motion, _ = exported(found, tmp_path / "capture.glb")
    document = open_document(tmp_path / "capture.glb")
    template = read_template(document)
    matrices = torch.tensor(read_bone_transforms(document, template, FRAMES))
    skin = SkinWeights(torch.tensor(template.weights), torch.tensor(template.weight_bones))
    vertices = torch.tensor(template.vertices)
    posed = dual_quaternion_blend(vertices, skin, matrices[..., :3, :3], matrices[..., :3, 3])
    assert (posed - found.actor.surface(motion)).norm(dim=-1).max() < TENTH_MM


def test_the_animation_plays_on_the_users_own_file(case: tuple, tmp_path: Path) -> None:
    _, own, found = case
    _, transforms = exported(found, tmp_path / "capture.glb")
    template = found.actor.template
    skin = SkinWeights(torch.tensor(template.weights), torch.tensor(template.weight_bones))
    vertices = torch.tensor(template.vertices)
    expected = linear_blend(vertices, skin, transforms[..., :3, :3], transforms[..., :3, 3])
    matrix = found.correction.matrix
    for frame in (0, 13, FRAMES - 1):
        theirs = played_on(own, tmp_path / "capture.glb", frame, RATE)
        ours = theirs @ matrix[:3, :3].T + matrix[:3, 3]
        np.testing.assert_allclose(ours, expected[frame], atol=TENTH_MM)


def test_extra_bones_go_with_their_nearest_joint() -> None:
    rig = RIGS["Unreal, 150 bones"]
    template = rig.template()
    assert len(template.bone_names) == 150
    found = load_from(template)
    owner = dict(zip(template.bone_names, found.actor.bone_joints, strict=True))
    assert JOINTS[owner["root"]] == JOINTS[owner["spine_01"]] == "pelvis"
    for bone, parent in enumerate(template.bone_parents):
        name = template.bone_names[bone]
        if name.startswith("helper"):
            assert owner[name] == owner[template.bone_names[parent]]


def load_from(template, mapping: ActorMapping | None = None) -> ImportedActor:  # type: ignore[no-untyped-def]
    from perfcap.io.actor_import import rig_character
    from perfcap.io.gltf_read import Character

    return rig_character(Character(template, (), ()), mapping)


def test_names_that_call_left_right_are_exchanged() -> None:
    other = {"Left": "Right", "Right": "Left"}
    names = {
        joint: name.replace(side, other[side]) if (side := _side(name)) else name
        for joint, name in MIXAMO.items()
    }
    found = load_from(Rig(names).template())
    assert found.bones.swapped
    assert found.actor.skeleton.rest_positions[JOINTS.index("l_hip"), 0] > 0
    assert any(finding.subject == "left and right" for finding in found.about_file)


def _side(name: str) -> str:
    return "Left" if "Left" in name else "Right" if "Right" in name else ""


def test_a_mapping_is_obeyed_even_where_it_is_wrong() -> None:
    template = Rig(MIXAMO).template()
    given = {"l_hip": "mixamorig:RightUpLeg", "r_hip": "mixamorig:LeftUpLeg",
             "l_knee": "mixamorig:RightLeg", "r_knee": "mixamorig:LeftLeg",
             "l_ankle": "mixamorig:RightFoot", "r_ankle": "mixamorig:LeftFoot"}  # fmt: skip
    found = load_from(template, ActorMapping(given))
    assert found.bones.sources["l_hip"] == "mapping"
    with pytest.raises(InputError, match="exchange l_ and r_"):
        require_sound(Path("a.glb"), found.findings)


def test_a_stated_unit_is_obeyed() -> None:
    template = transformed(Rig(UNREAL).template(), 0.45 * np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="metres_per_unit"):
        load_from(transformed(template, 40 * np.eye(3), np.zeros(3)))
    found = load_from(template, ActorMapping(metres_per_unit=1.0))
    assert any("m tall" in finding.what for finding in found.about_actor)


def test_landmarks_are_on_the_skin_where_no_bone_marks_them() -> None:
    actor = load_from(Rig(BIPED).template()).actor
    rest = actor.skeleton.rest_landmarks
    names = actor.skeleton.rig.landmarks
    top = rest[names.index("head_top")]
    assert top[1] == pytest.approx(actor.vertices[:, 1].max())
    for side, sign in (("l", 1.0), ("r", -1.0)):
        toe, ankle = rest[names.index(f"{side}_toe")], rest[names.index(f"{side}_ankle")]
        assert 0.1 < toe[2] - ankle[2] < 0.2
        assert sign * toe[0] > 0
        assert toe[1] < ankle[1]


def test_a_person_far_from_the_floor_is_moved_there() -> None:
    template = transformed(Rig(MIXAMO).template(), np.eye(3), np.array([3.0, 1.0, -2.0]))
    actor = load_from(template).actor
    assert actor.vertices[:, 1].min() == pytest.approx(0, abs=1e-6)
    assert actor.skeleton.rest_positions[0, [0, 2]].abs().max() < 1e-6


def test_a_shipped_actor_is_not_touched() -> None:
    actor = load_actor("sam")
    assert actor.template.space is None
    assert actor.template.joint_bones == {n: actor.template.bone(n) for n in JOINTS}
    marks = {name: bone for name, (bone, _) in actor.template.landmarks.items()}
    assert marks == {"head_top": 3, **{f"{s}_toe": actor.template.bone(f"{s}_ankle") for s in "lr"}}


def test_loose_limbs_are_one_tree_in_bvh(tmp_path: Path) -> None:
    actor = load_from(RIGS["Rigify, loose limbs, z up armature"].template()).actor
    assert np.count_nonzero(actor.template.bone_parents < 0) == 5
    transforms = actor.bone_transforms(sway(actor, 4)).numpy()
    save_bvh(tmp_path / "a.bvh", bvh_motion(actor.template, transforms, RATE))
    rest = actor.template.bone_rest[:, :3, 3, None]
    expected = (transforms[..., :3, :3] @ rest)[..., 0] + transforms[..., :3, 3]
    read = load_bvh(tmp_path / "a.bvh")
    order = [actor.template.bone_names.index(name) for name in read.names]
    np.testing.assert_allclose(joint_positions(read), expected[:, order], atol=1e-5)


def test_random_damage_never_ends_in_another_error(tmp_path: Path) -> None:
    path = tmp_path / "own.glb"
    RIGS["Mixamo, centimetres, armature"].write(path)
    data = path.read_bytes()
    text = len(data) // 3  # where most of the structure is
    rng = np.random.default_rng(0)
    refused = 0
    for trial in range(80):
        damaged = bytearray(data)
        for place in rng.integers(0, text if trial % 2 else len(data), 3):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            import_actor(path)
        except InputError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 15


def test_scales_of_almost_one_are_rounding(tmp_path: Path) -> None:
    rig = Rig(MIXAMO, 1.0 + 2e-6, armature=True)
    rig.write(tmp_path / "own.glb")
    assert import_actor(tmp_path / "own.glb").actor.template.space is None
