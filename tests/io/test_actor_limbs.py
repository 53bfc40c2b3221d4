"""Joints beside the places where limbs bend, on both sides alike."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from foreign_rigs import RIGS

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.template import Template
from perfcap.io.actor import load_actor
from perfcap.io.actor_limbs import limb_findings
from perfcap.io.body_model import load_body_model
from perfcap.io.doctor import Severity
from perfcap.io.gltf_write import save_animation


@pytest.fixture(scope="module")
def sam() -> Template:
    return load_actor("sam").template


def moved(template: Template, joint: str, towards: str, share: float) -> Template:
    """With a joint of both sides that much nearer to another one of its side."""
    rest = template.bone_rest.copy()
    for side in "lr":
        own, other = template.joint_bones[side + joint], template.joint_bones[side + towards]
        rest[own, :3, 3] += share * (rest[other, :3, 3] - rest[own, :3, 3])
    return replace(template, bone_rest=rest)


def told(template: Template) -> str:
    found = list(limb_findings(template))
    assert all(each.subject == "limbs" for each in found)
    assert all(each.severity is Severity.WARNING for each in found)
    return "; ".join(each.what for each in found)


@pytest.mark.parametrize(
    ("joint", "towards", "share", "what"),
    [
        ("_elbow", "_shoulder", 0.4, "upper arms to forearms is 0."),
        ("_elbow", "_shoulder", 0.4, "l_elbow by"),
        ("_elbow", "_wrist", 0.4, "r_elbow by"),
        ("_knee", "_hip", 0.25, "r_knee by"),
        ("_shoulder", "_elbow", 0.35, "l_shoulder by"),
        ("_hip", "_knee", 0.5, "thighs to shanks is 0."),
    ],
)
def test_joints_at_wrong_places_on_both_sides_are_told(
    sam: Template, joint: str, towards: str, share: float, what: str
) -> None:
    assert what in told(moved(sam, joint, towards, share))


def test_hips_far_apart_are_told(sam: Template) -> None:
    rest = sam.bone_rest.copy()
    for side in "lr":
        rest[sam.joint_bones[f"{side}_hip"], 0, 3] *= 2
    assert "hips to shoulders is" in told(replace(sam, bone_rest=rest))


@pytest.mark.long
def test_sound_characters_have_no_such_finding(sam: Template) -> None:
    assert not told(sam)
    body = load_body_model("ada")
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        shape = 0.8 * torch.randn(body.surface.components, generator=generator, dtype=torch.float64)
        template = body.template(shape)
        joints = {name: template.bone(name) for name in JOINTS}
        assert not told(replace(template, joint_bones=joints))


@pytest.mark.parametrize("name", RIGS)
def test_rigs_of_other_programs_have_no_such_finding(name: str) -> None:
    rig = RIGS[name]
    template = rig.template()
    joints = {joint: template.bone(bone) for joint, bone in rig.names.items()}
    assert not told(replace(template, joint_bones=joints))


def test_loading_such_a_character_warns(
    sam: Template, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    still = np.tile(np.eye(4), (1, len(sam.bone_names), 1, 1))
    for name, template in (("good", sam), ("bad", moved(sam, "_elbow", "_shoulder", 0.4))):
        save_animation(tmp_path / f"{name}.glb", replace(template, joint_bones={}), still, 30)
    with caplog.at_level(logging.WARNING):
        load_actor(tmp_path / "good.glb")
        assert "limbs" not in caplog.text
        load_actor(tmp_path / "bad.glb")
    assert "limbs: the length of upper arms" in caplog.text


def test_loading_one_whose_skin_does_not_fit_warns(
    sam: Template, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    left, right = (sam.joint_bones[f"{side}_knee"] for side in "lr")
    exchanged = np.arange(len(sam.bone_names))
    exchanged[[left, right]] = right, left
    bad = replace(sam, weight_bones=exchanged[sam.weight_bones])
    aside = replace(sam, vertices=sam.vertices + np.array([0.12, 0.0, 0.0]))
    still = np.tile(np.eye(4), (1, len(sam.bone_names), 1, 1))
    for name, template in (("good", sam), ("bad", bad), ("aside", aside)):
        save_animation(tmp_path / f"{name}.glb", replace(template, joint_bones={}), still, 30)
    with caplog.at_level(logging.WARNING):
        load_actor(tmp_path / "good.glb")
        assert "weights" not in caplog.text and "joints" not in caplog.text
        load_actor(tmp_path / "bad.glb")
        load_actor(tmp_path / "aside.glb")
    assert "weights: l_knee moves what lies about r_knee" in caplog.text
    assert "lie outside the mesh" in caplog.text
