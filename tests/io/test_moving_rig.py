"""Skeletons in motion: captures, BVH and animated characters say the same of one motion."""

import json
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from foreign_rigs import MIXAMO, RIGS, Z_UP, transformed
from synthetic import actor
from takes import sway

from perfcap.actor.anatomy import JOINTS
from perfcap.errors import InputError
from perfcap.io.actor import load_actor
from perfcap.io.actor_import import ActorMapping, import_actor
from perfcap.io.bvh_read import bvh_motion
from perfcap.io.bvh_write import save_bvh
from perfcap.io.gltf_write import save_animation
from perfcap.io.moving_rig import read_moving_rig

PERSON = actor()
MOTION = sway(PERSON, 12, 24.0)


@pytest.fixture(scope="module")
def truth() -> tuple[np.ndarray, np.ndarray]:
    pose = PERSON.skeleton(MOTION)
    return pose.rotation.numpy(), pose.position.numpy()


def named() -> object:
    """The person with Mixamo's names."""
    template = PERSON.template
    names = tuple(MIXAMO[name] for name in template.bone_names)
    return replace(template, bone_names=names, joint_bones={}, landmarks={})


def close(found: object, truth: tuple[np.ndarray, np.ndarray], atol: float = 2e-5) -> None:
    np.testing.assert_allclose(found.rotation, truth[0], atol=atol)
    np.testing.assert_allclose(found.position, truth[1], atol=atol)


@pytest.mark.parametrize("unit", [0.01, 1.0, 0.0254])
def test_bvh(unit: float, truth: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    """Whatever its unit: the height of the figure tells."""
    transforms = PERSON.bone_transforms(MOTION).numpy()
    save_bvh(tmp_path / "a.bvh", bvh_motion(named(), transforms, 24.0), unit)
    found = read_moving_rig(tmp_path / "a.bvh")
    assert found.rate == pytest.approx(24.0) and not found.notes
    assert found.frames.tolist() == list(range(12))
    # the root's offset is not in BVH: poses are, and places of a rest pose are not
    close(found, truth)


def with_rows(path: Path, change: Callable[[int, np.ndarray], np.ndarray]) -> Path:
    """A BVH whose rows of numbers are changed."""
    head, rows = path.read_text().split("Frame Time:")
    first, *lines = rows.strip().splitlines()
    values = [change(n, np.array(line.split(), dtype=float)) for n, line in enumerate(lines)]
    text = "\n".join(" ".join(f"{v:.9g}" for v in row) for row in values)
    path.write_text(f"{head}Frame Time: {first}\n{text}\n")
    return path


def test_turns_that_are_odd_are_told(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    motion = bvh_motion(named(), PERSON.bone_transforms(MOTION).numpy(), 24.0)
    save_bvh(path, motion)
    with_rows(path, lambda n, row: row * (0.0 if n in (0, 4, 5, 9) else 1.0))
    (line,) = read_moving_rig(path).notes
    assert "all zero in frames 4-5, 9:" in line
    assert not read_moving_rig(path, slice(6, 9)).notes
    save_bvh(path, motion)
    places = np.arange(3)  # of the root come first
    with_rows(path, lambda n, row: np.r_[row[places], np.radians(row[3:])])
    (line,) = read_moving_rig(path).notes
    assert "in radians? BVH has degrees" in line


def test_parts_that_end_before_they_should(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    save_bvh(path, bvh_motion(named(), PERSON.bone_transforms(MOTION).numpy(), 24.0))
    assert not read_moving_rig(path, slice(3, 12)).notes
    (line,) = read_moving_rig(path, slice(3, 40)).notes
    assert "ends after 12 frames; --frames asks for 40" in line


def test_bvh_of_a_unit_that_nobody_knows(tmp_path: Path) -> None:
    transforms = PERSON.bone_transforms(MOTION).numpy()
    save_bvh(tmp_path / "a.bvh", bvh_motion(named(), transforms, 24.0), 0.056444)
    found = read_moving_rig(tmp_path / "a.bvh")
    assert "its unit is not known" in found.notes[0]
    stated = read_moving_rig(tmp_path / "a.bvh", mapping=ActorMapping({}, 0.056444))
    assert not stated.notes
    ratio = np.linalg.norm(found.position) / np.linalg.norm(stated.position)
    np.testing.assert_allclose(found.position, ratio * stated.position, atol=1e-9)
    np.testing.assert_allclose(found.rotation, stated.rotation)


def test_a_stated_unit_that_makes_no_person_is_named(tmp_path: Path) -> None:
    save_bvh(tmp_path / "a.bvh", bvh_motion(named(), PERSON.bone_transforms(MOTION).numpy(), 24.0))
    (line,) = read_moving_rig(tmp_path / "a.bvh", mapping=ActorMapping({}, 1.0)).notes
    assert "m tall with metres_per_unit = 1, a grown person" in line


@pytest.mark.parametrize("joints", [("hip",), ("shoulder", "elbow", "wrist", "hip", "knee")])
def test_a_mapping_that_exchanges_sides_is_refused(joints: tuple[str, ...], tmp_path: Path) -> None:
    save_bvh(tmp_path / "a.bvh", bvh_motion(named(), PERSON.bone_transforms(MOTION).numpy(), 24.0))
    sides = {"l": "r", "r": "l"}
    names = {f"{a}_{j}": MIXAMO[f"{b}_{j}"] for a, b in sides.items() for j in joints}
    with pytest.raises(InputError, match=r"limbs: |left and right: "):
        read_moving_rig(tmp_path / "a.bvh", mapping=ActorMapping(names))


def test_a_mapping_that_takes_the_neck_for_the_head_is_refused(tmp_path: Path) -> None:
    save_bvh(tmp_path / "a.bvh", bvh_motion(named(), PERSON.bone_transforms(MOTION).numpy(), 24.0))
    names = {"neck": MIXAMO["head"], "head": MIXAMO["neck"]}
    with pytest.raises(InputError, match=r"which does not hang on .*Head, the bone of neck"):
        read_moving_rig(tmp_path / "a.bvh", mapping=ActorMapping(names))


def test_bvh_whose_offsets_are_no_person(
    truth: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    """Every bone along +x, as some programs write: a frame in which the person stands serves."""
    motion = bvh_motion(named(), PERSON.bone_transforms(MOTION).numpy(), 24.0)
    length = np.linalg.norm(motion.offsets, axis=1)
    along = np.where(length[:, None] > 0, motion.offsets / np.maximum(length, 1e-9)[:, None], 0)
    x = np.array([1.0, 0, 0])
    turns = np.tile(np.eye(3), (len(length), 1, 1))  # of each joint's frame, taking x to its child
    child = {int(p): j for j, p in enumerate(motion.parents) if p >= 0}
    for joint, other in child.items():
        axis = np.cross(x, along[other])
        sine, cosine = np.linalg.norm(axis), along[other] @ x
        k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turns[joint] = np.eye(3) + k + k @ k * (1 - cosine) / max(sine**2, 1e-12)
    parent = np.maximum(motion.parents, 0)
    above = np.where((motion.parents < 0)[:, None, None], np.eye(3), turns[parent])
    twisted = replace(
        motion,
        offsets=(above.mT @ motion.offsets[..., None])[..., 0],
        rotations=above.mT @ motion.rotations @ turns,
        positions=(above.mT @ motion.positions[..., None])[..., 0],
        ends=None,
    )
    save_bvh(tmp_path / "a.bvh", twisted)
    found = read_moving_rig(tmp_path / "a.bvh")
    assert any("its rest pose is none of a person" in note for note in found.notes)
    np.testing.assert_allclose(found.position, truth[1], atol=2e-4)


@pytest.mark.parametrize("name", [n for n in RIGS if "no names" not in n])
def test_characters(name: str, truth: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    """Units, axes, armatures and bones of other programs."""
    rig = RIGS[name]
    made = rig.write(tmp_path / "rest.glb")
    imported = import_actor(tmp_path / "rest.glb")
    motion = sway(imported.actor, 12, 24.0)
    transforms = imported.actor.bone_transforms(motion).numpy()
    save_animation(tmp_path / "a.glb", imported.actor.template, transforms, 24.0)
    found = read_moving_rig(tmp_path / "a.glb")
    pose = imported.actor.skeleton(motion)
    assert len(made.bone_names) >= 16 and found.rate == 24.0
    close(found, (pose.rotation.numpy(), pose.position.numpy()), 1e-4)


def test_axes_of_a_character_that_lies(tmp_path: Path) -> None:
    """A file in centimetres with z up: the motion stands upright, in metres."""
    raw = transformed(named(), 100 * Z_UP.T, np.zeros(3))
    matrices = PERSON.bone_transforms(MOTION).numpy()
    big, small = np.eye(4), np.eye(4)
    big[:3, :3], small[:3, :3] = 100 * Z_UP.T, Z_UP / 100
    save_animation(tmp_path / "a.glb", raw, big @ matrices @ small, 24.0)
    pose = PERSON.skeleton(MOTION)
    found = read_moving_rig(tmp_path / "a.glb", slice(3, 9))
    assert found.frames.tolist() == [3, 4, 5, 6, 7, 8]
    close(found, (pose.rotation[3:9].numpy(), pose.position[3:9].numpy()), 1e-4)


def rewritten(path: Path, out: Path, change: object) -> Path:
    """A GLB with another tree."""
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + size])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    out.write_bytes(head + struct.pack("<I4s", len(text), b"JSON") + text + rest)
    return out


def test_what_is_left_out_of_a_file_is_told(moving: Path, tmp_path: Path) -> None:
    def another_clip(tree: dict[str, Any]) -> None:
        tree["animations"][0]["name"] = "walk"
        tree["animations"].append({**tree["animations"][0], "name": "idle"})

    def another_person(tree: dict[str, Any]) -> None:
        nodes, skin = tree["nodes"], tree["skins"][0]
        first = len(nodes)
        nodes += [{"name": f"other {n}"} for n in range(len(skin["joints"]))]
        own = {**skin, "joints": [first + n for n in range(len(skin["joints"]))]}
        own.pop("skeleton", None)
        tree["skins"].append(own)
        body = next(node for node in nodes if "skin" in node)
        nodes.append({**body, "skin": 1, "name": "other body"})
        tree["scenes"][0]["nodes"] += range(first, len(nodes))

    assert not read_moving_rig(moving).notes
    (told,) = read_moving_rig(rewritten(moving, tmp_path / "clips.glb", another_clip)).notes
    assert "its first animation, 'walk', is taken; 'idle' are not" in told
    notes = read_moving_rig(rewritten(moving, tmp_path / "people.glb", another_person)).notes
    assert any("2 skeletons of a person's size" in note for note in notes)


@pytest.fixture
def moving(tmp_path: Path) -> Path:
    path = tmp_path / "moving.glb"
    save_animation(path, named(), PERSON.bone_transforms(MOTION).numpy(), 24.0)
    return path


def test_keys_that_stay(moving: Path, tmp_path: Path) -> None:
    """STEP of a file with a key every frame is the same at every frame."""

    def step(tree: dict) -> None:
        for sampler in tree["animations"][0]["samplers"]:
            sampler["interpolation"] = "STEP"

    one = read_moving_rig(moving)
    other = read_moving_rig(rewritten(moving, tmp_path / "b.glb", step))
    np.testing.assert_allclose(other.position, one.position, atol=1e-6)  # keys are float32


WRONG = {
    "no animation": (lambda tree: tree.pop("animations"), "holds no animation"),
    "no channels": (lambda tree: tree["animations"][0].pop("channels"), "no channels or samplers"),
    "unknown interpolation": (
        lambda tree: tree["animations"][0]["samplers"][0].update(interpolation="BEZIER"),
        "interpolated by 'BEZIER'",
    ),
    "cubic without tangents": (
        lambda tree: tree["animations"][0]["samplers"][0].update(interpolation="CUBICSPLINE"),
        "keys have",
    ),
    "a path that is none": (
        lambda tree: [c["target"].update(path=[]) for c in tree["animations"][0]["channels"]],
        "holds no animation",
    ),
    "no such node": (
        lambda tree: tree["animations"][0]["channels"][0]["target"].update(node=10**6),
        "target.node is 1000000",
    ),
}


@pytest.mark.parametrize("fault", WRONG)
def test_damaged_animations(fault: str, moving: Path, tmp_path: Path) -> None:
    change, said = WRONG[fault]
    with pytest.raises(InputError, match=said):
        read_moving_rig(rewritten(moving, tmp_path / "b.glb", change))


def test_what_does_not_move(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(InputError, match="no such file or folder"):
        read_moving_rig(tmp_path / "nothing")
    with pytest.raises(InputError, match="is of no kind that moves"):
        read_moving_rig(tmp_path / "a.txt")
    with pytest.raises(InputError, match=r"has no run\.json"):
        read_moving_rig(tmp_path)


@pytest.mark.parametrize("read", [read_moving_rig, load_actor])
@pytest.mark.parametrize("name", ["hero.fbx", "Hero.FBX", "hero.dae", "hero.blend"])
def test_what_blender_must_convert(
    name: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(b"Kaydara FBX Binary  \x00")
    with pytest.raises(InputError, match=r"open it in Blender .* a \.glb"):
        read(tmp_path / name)


def test_frames_that_are_not_there(moving: Path) -> None:
    with pytest.raises(InputError, match="holds frames 0 to 11"):
        read_moving_rig(moving, slice(12, None))


def test_joints_are_in_order() -> None:
    assert PERSON.skeleton.rig.joints == JOINTS
    assert torch.equal(
        PERSON.skeleton.rest_motion().translation[0], PERSON.skeleton.rest_positions[0]
    )
