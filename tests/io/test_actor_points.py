"""Landmarks, limits and joints that are not those of an actor's body."""

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from foreign_rigs import RIGS, person
from synthetic import template

from perfcap.actor.actor import Actor
from perfcap.actor.rig import with_limits
from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.io.actor import examine, load_actor
from perfcap.io.actor_check import examine_actor, examine_joints
from perfcap.io.actor_folder import save_actor
from perfcap.io.actor_limbs import limb_findings
from perfcap.io.actor_points import landmark_findings, limit_findings
from perfcap.io.body_model import load_body_model
from perfcap.io.doctor import Severity

_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


@pytest.fixture(scope="module")
def sam() -> Template:
    return load_actor("sam").template


def marked(template: Template, move: Callable[[np.ndarray], object], *names: str) -> Template:
    """With landmarks at other places."""
    marks = dict(template.landmarks)
    marks |= {name: (marks[name][0], np.array(move(np.array(marks[name][1])))) for name in names}
    return replace(template, landmarks=marks)


TOES = ("l_toe", "r_toe")


@pytest.mark.parametrize(
    ("names", "move", "what"),
    [
        (TOES, lambda place: place * [-1, 1, 1], "l_toe lies at the other foot; r_toe lies at"),
        (TOES, lambda place: place * [1, 1, -1], "l_toe lies behind the ankle"),
        (TOES, lambda place: 1000 * place, "cm from the mesh"),
        (("head_top",), lambda place: place - [0, 0.25, 0], "head_top lies 10 cm below the head"),
        (("head_top",), lambda _: [0, 0.2, 0], "head_top lies"),
    ],
)
def test_landmarks_at_wrong_places_are_told(
    sam: Template, names: tuple[str, ...], move: Callable[[np.ndarray], object], what: str
) -> None:
    (found,) = landmark_findings(marked(sam, move, *names))
    assert found.severity is Severity.ERROR and what in found.what


@pytest.mark.parametrize(
    ("names", "move", "what"),
    [
        (TOES, lambda place: place + np.array([0, 0, 0.2]), "feet to shanks"),
        (("l_toe",), lambda place: place + np.array([0, 0, 0.08]), "from ankle to toe"),
        (("head_top",), lambda place: place + np.array([0, 0.25, 0]), "heads to trunk"),
    ],
)
def test_feet_and_heads_of_another_size_are_told(
    sam: Template, names: tuple[str, ...], move: Callable[[np.ndarray], object], what: str
) -> None:
    assert what in "; ".join(each.what for each in limb_findings(marked(sam, move, *names)))


@pytest.mark.parametrize(("raised", "told"), [(0.0, 0), (0.05, 0), (0.12, 1), (0.18, 1)])
def test_a_crown_above_the_body_is_told(sam: Template, raised: float, told: int) -> None:
    """As of a bone at the end of the head that is drawn too long."""
    found = list(
        landmark_findings(marked(sam, lambda place: place + np.array([0, raised, 0]), "head_top"))
    )
    assert len(found) == told
    assert all("above the mesh" in each.what for each in found)
    assert all(each.severity is Severity.WARNING for each in found)


@pytest.mark.parametrize(("cut", "told"), [(0.0, 0), (0.04, 0), (0.08, 1), (0.12, 1)])
def test_feet_that_went_with_the_floor_are_named(sam: Template, cut: float, told: int) -> None:
    low = float(sam.vertices[:, 1].min())
    kept = sam.vertices.copy()
    kept[:, 1] = np.maximum(kept[:, 1], low + cut)
    found = list(landmark_findings(replace(sam, vertices=kept)))
    assert len(found) == told
    assert all("below the mesh" in each.what for each in found)


def test_sound_bodies_have_sound_joints_and_landmarks(sam: Template) -> None:
    model = load_body_model("ada")
    generator = torch.Generator().manual_seed(3)
    drawn = [torch.randn(model.surface.components, generator=generator).double() for _ in range(4)]
    for each in (sam, template(), *(model.template(shape) for shape in drawn)):
        assert not examine_joints(each)
    for rig in RIGS.values():
        assert not list(landmark_findings(load_joints(rig.template(), rig.names)))


def load_joints(template: Template, names: dict[str, str]) -> Template:
    bones = {joint: template.bone(bone) for joint, bone in names.items()}
    return replace(template, joint_bones=bones)


def test_left_for_right_is_told_by_the_feet(sam: Template) -> None:
    bones = dict(sam.joint_bones)
    for name in _JOINTS:
        bones[f"l_{name}"], bones[f"r_{name}"] = bones[f"r_{name}"], bones[f"l_{name}"]
    found = [f for f in examine_joints(replace(sam, joint_bones=bones)) if "left" in f.subject]
    assert "right of where the feet point" in found[0].what
    assert found[0].severity is Severity.ERROR


def test_bones_that_are_called_like_joints_are_examined() -> None:
    assert not template().joint_bones
    assert not [f for f in examine_actor(template()) if f.severity is Severity.ERROR]
    without = replace(person(), bone_names=("root", *person().bone_names[1:]))
    assert not examine_joints(without) and examine_actor(without)


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        ({"l_knee_flexion": (-160, 0)}, "l_knee_flexion -160 to 0 of 0 to 160"),
        ({"r_hip_flexion": (-145, 30)}, "r_hip_flexion -145 to 30 of -30 to 145"),
        ({"l_elbow_flexion": (0, 2.6), "neck_axial": (-70, 70)}, "l_elbow_flexion 0 to 2.6 of"),
        ({"l_knee_flexion": (0, 90), "r_ankle_dorsiflexion": (-20, 46)}, ""),
        ({"l_shoulder_elevation": (-360, 360)}, ""),
        ({}, ""),
    ],
)
def test_limits_that_leave_little_are_told(
    sam: Template, limits: dict[str, tuple[float, float]], told: str
) -> None:
    rig = Actor(sam).skeleton.rig
    radians = {n: (np.radians(low), np.radians(high)) for n, (low, high) in limits.items()}
    found = "; ".join(each.what for each in limit_findings(with_limits(rig, radians)))
    assert told in found and bool(found) == bool(told)


def test_folders_of_actors_are_examined_as_they_are_loaded(
    sam: Template, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    save_actor(Actor(sam.rounded()), tmp_path)
    manifest = tmp_path / "manifest.toml"
    written = manifest.read_text()
    with caplog.at_level(logging.WARNING):
        load_actor(tmp_path)
        assert not caplog.text
        manifest.write_text(f"{written}\n[limits]\nl_knee_flexion = [-160, 0]\n")
        load_actor(tmp_path)
        assert "leave little of the degrees" in caplog.text
    assert any(each.subject == "limits" for each in examine(tmp_path).findings)
    knees = "l_knee", "r_knee"
    bones = [sam.bone_names[sam.joint_bones[name]] for name in knees]
    crossed = written
    for name, bone, other in zip(knees, bones, bones[::-1], strict=True):
        assert f'{name} = "{bone}"' in written
        crossed = crossed.replace(f'{name} = "{bone}"', f'{name} = "{other}"')
    manifest.write_text(crossed)
    with pytest.raises(InputError, match="does not hang on"):
        load_actor(tmp_path)


def test_a_mesh_that_its_manifest_was_not_written_for_is_told(
    sam: Template, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    save_actor(Actor(sam.rounded()), tmp_path / "one")
    save_actor(Actor(replace(sam, vertices=1.01 * sam.vertices).rounded()), tmp_path / "two")
    (tmp_path / "two" / "actor.glb").rename(tmp_path / "one" / "actor.glb")
    load_actor(tmp_path / "one")
    assert "is not the file that manifest.toml was written for" in caplog.text
