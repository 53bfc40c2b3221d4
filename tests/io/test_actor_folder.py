"""Actors written as folders and read back."""

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from foreign_rigs import MIXAMO, RIGS, Rig
from gltf_files import one_pixel_png
from synthetic import clavicled, random_motion, rest_positions, template
from takes import marked_template, sway
from test_actor_import import load_from

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import human_rig
from perfcap.actor.rig import with_limits
from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.io.actor import examine, find_actor, load_actor, models_folder
from perfcap.io.actor_folder import read_manifest, save_actor

ARRAYS = ("vertices", "faces", "uv", "weights", "weight_bones", "bone_parents")


def textured(rig: Rig) -> Template:
    template = rig.template()
    uv = np.random.default_rng(0).uniform(size=(len(template.vertices), 2))
    return replace(template, uv=uv, texture=one_pixel_png()).rounded()


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_nothing_is_lost(rig: Rig, tmp_path: Path) -> None:
    actor = load_from(textured(rig)).actor
    for folder in (tmp_path / "one", tmp_path / "two"):  # saved, read, and saved again
        save_actor(actor, folder, licence="CC0-1.0", provenance='a "test"\\')
        read = load_actor(folder)
        for name in ARRAYS:
            one, two = getattr(actor.template, name), getattr(read.template, name)
            assert np.array_equal(one, two) and one.dtype == two.dtype, name
        assert read.template.texture == actor.template.texture
        assert read.template.bone_names == actor.template.bone_names
        assert read.template.joint_bones == actor.template.joint_bones
        assert read.template.name == actor.template.name
        np.testing.assert_allclose(read.template.bone_rest, actor.template.bone_rest, atol=1e-12)
        motion = sway(actor, 3)
        assert (read.surface(motion) - actor.surface(motion)).abs().max() < 1e-10
        actor = read
    manifest = read_manifest(tmp_path / "two/manifest.toml")
    assert (manifest.licence, manifest.provenance) == ("CC0-1.0", 'a "test"\\')
    assert not find_actor(tmp_path / "two").generic


def test_ends_that_are_bones_come_back(tmp_path: Path) -> None:
    actor = Actor(marked_template().rounded())
    save_actor(actor, tmp_path)
    read = load_actor(tmp_path)
    assert set(read.template.landmarks) == {"head_top", "l_toe", "r_toe"}
    motion = sway(actor, 3)
    assert torch.allclose(read.joints(motion), actor.joints(motion), atol=1e-6)


def test_limits_of_an_actor_are_kept(tmp_path: Path) -> None:
    plain = load_from(Rig(MIXAMO).template()).actor
    limits = {"l_knee_flexion": (0.1, 1.0), "neck_axial": (-0.2, 0.3)}
    actor = Actor(plain.template, with_limits(plain.skeleton.rig, limits))
    save_actor(actor, tmp_path / "stiff", generic=True, shape_space="shape.npz")
    read = load_actor(tmp_path / "stiff")
    assert (read.skeleton.lower - actor.skeleton.lower).abs().max() < 1e-12
    assert (read.skeleton.upper - actor.skeleton.upper).abs().max() < 1e-12
    manifest = read_manifest(tmp_path / "stiff/manifest.toml")
    assert set(manifest.limits) == set(limits)
    assert manifest.shape_space == "shape.npz" and find_actor(tmp_path / "stiff").generic


@pytest.mark.long
def test_limits_beside_a_mesh_whose_joints_are_found(tmp_path: Path) -> None:
    """A manifest may say nothing of joints, as that of the shipped actor."""
    shutil.copytree(models_folder() / "actors" / "sam", tmp_path / "sam")
    usual = load_actor(tmp_path / "sam")
    with (tmp_path / "sam" / "manifest.toml").open("a") as file:
        file.write("\n[limits]\nl_knee_flexion = [5, 60]\n")
    stiff = load_actor(tmp_path / "sam")
    place = [hinge.name for hinge in stiff.skeleton.rig.hinges].index("l_knee_flexion")
    found = stiff.skeleton.lower[place], stiff.skeleton.upper[place]
    assert [math.degrees(float(f)) for f in found] == pytest.approx([5, 60])
    assert int((stiff.skeleton.upper != usual.skeleton.upper).sum()) == 1
    assert torch.equal(examine(tmp_path / "sam").actor.skeleton.upper, stiff.skeleton.upper)


@pytest.mark.parametrize(("most", "told"), [(1.57, True), (90, False)])
def test_limits_in_radians_are_told(
    tmp_path: Path, most: float, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "manifest.toml").write_text(f"[limits]\nl_knee_flexion = [0, {most}]\n")
    read_manifest(tmp_path / "manifest.toml")
    assert ["look like radians" in line for line in caplog.messages] == [True] * told


def test_what_a_manifest_says_in_vain_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "manifest.toml").write_text("[limit]\nl_knee_flexion = [0, 90]\n")
    read_manifest(tmp_path / "manifest.toml")
    assert "limit are not known and count for nothing; expected some of" in caplog.text
    caplog.clear()
    read_manifest(models_folder() / "actors" / "sam" / "manifest.toml")
    assert not caplog.messages


def test_bad_limits_are_refused() -> None:
    rig = load_from(Rig(MIXAMO).template()).actor.skeleton.rig
    with pytest.raises(InputError, match="tail is no angle"):
        with_limits(rig, {"tail": (0, 1)})
    with pytest.raises(InputError, match="lower below upper"):
        with_limits(rig, {"neck_axial": (1, 0)})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[joints]", "[joints", "is not TOML"),
        ('pelvis = "', 'hips = "', "joints are"),
        ('pelvis = "mixamorig:Hips"', 'pelvis = "Becken"', "names the bones Becken"),
        ('pelvis = "mixamorig:Hips"', "pelvis = 3", "is not as perfcap writes it"),
        ("position = [", 'position = ["x", ', "landmarks"),
        ("position = [", "position = [nan, ", "landmarks"),
        ('licence = "', 'licence = 3 # "', "licence is 3"),
        ("[joints]", "[limits]\ntail = [0, 1]\n[joints]", "tail is no angle"),
        ("[joints]", "[limits]\nneck_axial = [0]\n[joints]", "limits"),
        ("[joints]", "[limits]\nneck_axial = [90, 0]\n[joints]", "is 90 to 0 degrees"),
        ("[joints]", "x = " + "[" * 3000 + "\n[joints]", "manifest"),
    ],
)
def test_a_spoiled_manifest_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    save_actor(load_from(Rig(MIXAMO).template()).actor, tmp_path)
    path = tmp_path / "manifest.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message) as caught:
        load_actor(tmp_path)
    assert "manifest.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    actor = load_from(Rig(MIXAMO).template()).actor
    with pytest.raises(InputError, match="cannot be written"):
        save_actor(actor, tmp_path / "file")


def test_shipped_manifests_state_licence_and_origin() -> None:
    manifest = read_manifest(find_actor("sam").path.with_name("manifest.toml"))
    assert manifest.licence == "CC0-1.0" and "MakeHuman" in manifest.provenance
    assert manifest.generic and not manifest.joints


def test_clavicles_come_back_with_a_folder(tmp_path: Path) -> None:
    actor = Actor(clavicled().rounded())
    save_actor(actor, tmp_path / "actor")
    again = load_actor(str(tmp_path / "actor"))
    assert again.skeleton.rig.clavicles == actor.skeleton.rig.clavicles
    assert again.bone_joints == actor.bone_joints
    still = actor.with_still_shoulders()
    assert still.skeleton.rig.joints == Actor(template()).skeleton.rig.joints
    assert still.with_still_shoulders() is still
    motion = random_motion(still.skeleton, 2)
    same = ("pelvis", "head", "l_shoulder", "r_ankle")
    rows = [actor.template.bone_names.index(name) for name in same]
    turns = (a.bone_transforms(motion)[:, rows, :3, :3] for a in (actor, still))
    assert torch.allclose(*turns, atol=1e-12)
    plain = Actor(template(), human_rig(rest_positions()))
    assert torch.allclose(still.joints(motion), plain.joints(motion), atol=1e-6)  # rounded
