"""Faults of actors, each told when it is there and not when it is not."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from foreign_rigs import MIXAMO, Rig, person
from synthetic import rest_positions

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.template import Template
from perfcap.io.actor_check import examine_actor, winding_numbers
from perfcap.io.doctor import Severity


def joined(template: Template | None = None) -> Template:
    template = template or person()
    return replace(template, joint_bones={name: template.bone(name) for name in JOINTS})


def told(template: Template) -> dict[str, tuple[Severity, str]]:
    """Severity and words of the findings by subject; the first severity where there are several."""
    found: dict[str, tuple[Severity, str]] = {}
    for finding in examine_actor(template):
        severity, what = found.get(finding.subject, (finding.severity, ""))
        found[finding.subject] = severity, what + finding.what
    return found


def box(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7),
             (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]  # fmt: skip
    return low + corners * (high - low), np.array(faces)


def boxed(flip: bool = False) -> Template:
    """The joints in one closed box."""
    template = joined()
    places = template.bone_rest[:, :3, 3]
    vertices, faces = box(places.min(0) - 0.1, places.max(0) + np.array([0.1, 0.25, 0.1]))
    return replace(
        template,
        vertices=vertices,
        faces=faces[:, ::-1] if flip else faces,
        weight_bones=np.arange(8)[:, None],
        weights=np.ones((8, 1)),
    )


def test_winding_numbers_tell_inside_from_outside() -> None:
    vertices, faces = box(np.zeros(3), np.ones(3))
    points = np.array([[0.5, 0.5, 0.5], [0.1, 0.9, 0.2], [1.5, 0.5, 0.5]])
    np.testing.assert_allclose(winding_numbers(points, vertices[faces]), [1, 1, 0], atol=1e-12)
    open_box = vertices[faces[2:]]
    assert 0.5 < winding_numbers(points[:1], open_box)[0] < 1


def test_a_sound_mesh_has_no_mesh_findings() -> None:
    assert not told(boxed()).keys() & {"mesh", "faces", "joints", "rest pose", "skeleton", "scale"}


def test_inverted_faces_are_told() -> None:
    assert "inside out" in told(boxed(flip=True))["faces"][1]
    mixed = boxed()
    faces = mixed.faces.copy()
    faces[:2] = faces[:2, ::-1]
    assert "opposite ways" in told(replace(mixed, faces=faces))["faces"][1]


def test_holes_and_folds_are_told() -> None:
    sound = boxed()
    assert told(replace(sound, faces=sound.faces[1:]))["mesh"][1].startswith("1 holes")
    fold = np.concatenate((sound.faces, sound.faces[:1, [0, 1, 1]] * [1, 1, 0] + [[0, 0, 7]]))
    assert "more than two triangles" in told(replace(sound, faces=fold))["mesh"][1]


def test_joints_outside_are_told() -> None:
    sound = boxed()
    rest = sound.bone_rest.copy()
    rest[sound.bone("l_wrist"), :3, 3] += [3, 0, 0]
    assert told(replace(sound, bone_rest=rest))["joints"][1].startswith("l_wrist lie outside")


def test_bones_without_skin_are_told() -> None:
    template = joined()
    bones = np.where(template.weight_bones == template.bone("l_wrist"), 0, template.weight_bones)
    assert told(replace(template, weight_bones=bones))["weights"][1] == "l_wrist move no vertex"
    assert "weights" not in told(template)


@pytest.mark.parametrize(
    ("one", "other"), [("l_elbow", "r_elbow"), ("l_hip", "r_hip"), ("r_wrist", "head")]
)
def test_weights_on_the_wrong_bones_are_told(one: str, other: str) -> None:
    template = joined()
    a, b = template.bone(one), template.bone(other)
    bones = template.weight_bones
    bones = np.where(bones == a, b, np.where(bones == b, a, bones))
    severity, what = told(replace(template, weight_bones=bones))["weights"]
    assert severity is Severity.WARNING
    assert f"{one} moves what lies about" in what and f"{other} moves what lies about" in what


def test_a_joint_at_the_wrong_place_on_one_side_is_told() -> None:
    template = joined()
    rest = template.bone_rest.copy()
    rest[template.bone("l_knee"), 1, 3] -= 0.12
    assert "limbs" not in told(template)
    severity, what = told(replace(template, bone_rest=rest))["limbs"]
    assert severity is Severity.WARNING
    assert "from hip to knee" in what and "from knee to ankle" in what


@pytest.mark.parametrize(
    ("pose", "what", "severity"),
    [
        ({"arms": 5.0}, "lifted by 5 degrees only", Severity.WARNING),
        ({"arms": 150.0}, "lifted by 150 degrees", Severity.ERROR),
        ({"knees": 90.0}, "bent by 90 degrees", Severity.ERROR),
    ],
)
def test_rest_poses_far_from_a_and_t_are_told(
    pose: dict[str, float], what: str, severity: Severity
) -> None:
    at = rest_positions(**pose)
    template = joined()
    rest = template.bone_rest.copy()
    rest[:, :3, 3] = torch.stack([at[name] for name in template.bone_names]).numpy()
    found = [
        f for f in examine_actor(replace(template, bone_rest=rest)) if f.subject == "rest pose"
    ]
    assert any(what in finding.what and finding.severity is severity for finding in found)


@pytest.mark.parametrize(
    ("part", "one", "other"),
    [
        ("limbs", "l_elbow", "l_wrist"),
        ("limbs", "l_elbow", "r_elbow"),
        ("limbs", "r_knee", "r_hip"),
        ("trunk", "pelvis", "spine"),
        ("trunk", "spine", "neck"),
        ("trunk", "neck", "head"),
    ],
)
def test_limbs_and_necks_put_together_wrongly_are_told(part: str, one: str, other: str) -> None:
    template = joined()
    assert part not in told(template)
    bones = dict(template.joint_bones)
    bones[one], bones[other] = bones[other], bones[one]
    severity, what = told(replace(template, joint_bones=bones))[part]
    assert severity is Severity.ERROR and "does not hang on" in what


@pytest.mark.parametrize("limb", [("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")])
def test_arms_or_legs_alone_on_the_other_side_are_told(limb: tuple[str, ...]) -> None:
    """Whoever names the arms by the picture's sides may leave the legs to their own names."""
    template = joined()
    assert "left and right" not in told(template)
    bones = dict(template.joint_bones)
    for joint in limb:
        left, right = f"l_{joint}", f"r_{joint}"
        bones[left], bones[right] = bones[right], bones[left]
    severity, what = told(replace(template, joint_bones=bones))["left and right"]
    assert severity is Severity.ERROR and "on the side of r_hip" in what


def test_two_people_are_told() -> None:
    one, shift = joined(), np.array([1.0, 0, 0])
    rest = one.bone_rest.copy()
    rest[:, :3, 3] += shift
    count, bones = len(one.vertices), len(one.bone_names)
    two = replace(
        one,
        vertices=np.concatenate((one.vertices, one.vertices + shift)),
        faces=np.concatenate((one.faces, one.faces + count)),
        bone_names=(*one.bone_names, *(f"{name}_2" for name in one.bone_names)),
        bone_parents=np.concatenate(
            (one.bone_parents, np.where(one.bone_parents < 0, -1, one.bone_parents + bones))
        ),
        bone_rest=np.concatenate((one.bone_rest, rest)),
        weight_bones=np.concatenate((one.weight_bones, one.weight_bones + bones)),
        weights=np.concatenate((one.weights, one.weights)),
    )
    severity, what = told(two)["skeleton"]
    assert severity is Severity.ERROR and "2 skeletons" in what
    loose = joined()
    assert "skeleton" not in told(loose)


def test_giants_are_told() -> None:
    template = Rig(MIXAMO).template()
    names = {joint: template.bone(name) for joint, name in MIXAMO.items()}
    rest = template.bone_rest.copy()
    rest[:, :3, 3] *= 1.5
    giant = replace(template, vertices=1.5 * template.vertices, bone_rest=rest, joint_bones=names)
    assert "m tall" in told(giant)["scale"][1]
