"""What other programs open has y up, whatever the world of the capture."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from takes import detect, make_take

from perfcap.io.bvh_read import joint_positions, load_bvh
from perfcap.io.gltf_clip import sample_clip
from perfcap.io.gltf_document import open_document
from perfcap.io.gltf_read import load_template, read_character
from perfcap.io.gltf_scene import read_tree
from perfcap.io.moving_rig import read_moving_rig
from perfcap.io.result import read_result
from perfcap.pipeline import CaptureConfig, Person, Scene, Stage, capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.result_files import write_result
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface
from perfcap.pipeline.surroundings import axis, upright

FRAMES = 9
WORLDS = {
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "-y": np.diag([1.0, -1, -1]),
    "x": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}  # up in them, and their turn from y up


def performance(world: np.ndarray) -> Performance:
    """A person who stands, in a world that is turned so."""
    take = make_take(FRAMES)
    turn = torch.tensor(world)
    own = Rotation.from_rotvec(take.truth.rotation.numpy()).as_matrix()
    motion = replace(
        take.truth,
        rotation=torch.tensor(Rotation.from_matrix(world @ own).as_rotvec()),
        translation=take.truth.translation @ turn.mT,
    )
    cameras = replace(take.cameras, rotation=take.cameras.rotation @ turn.mT)
    settings = CaptureConfig()
    found = Performance(take.actor, cameras, take.detections, motion, take.rate, settings)
    surface = StoredSurface.empty(FRAMES, len(take.actor.vertices))
    surface.write(0, SkinnedSurface(take.actor, motion)[:])
    return replace(found, surface=surface)


def played(path: Path) -> np.ndarray:
    """Where a player of glTF puts the bones, (F, B, 3)."""
    document = open_document(path)
    nodes = np.array(read_character(document).nodes)
    return sample_clip(document, read_tree(document), nodes).world[..., :3, 3]


@pytest.mark.parametrize("up", WORLDS)
def test_files_for_other_programs_have_y_up(up: str, tmp_path: Path) -> None:
    expected = performance(WORLDS["y"])
    bones = (expected.bone_transforms() @ expected.actor.template.bone_rest)[..., :3, 3]
    found = performance(WORLDS[up])
    found.save(tmp_path)
    turn = np.eye(3)
    if up == "x":  # the smallest turn that makes it y, and another heading
        turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ WORLDS["x"]
    assert np.abs(played(tmp_path / "capture.glb") - bones @ turn.T).max() < 1e-5
    bvh = load_bvh(tmp_path / "motion.bvh")
    order = [bvh.names.index(name) for name in found.actor.template.bone_names]
    assert np.abs(joint_positions(bvh)[:, order] - bones @ turn.T).max() < 1e-4
    for name in ("capture.glb", "motion.bvh"):  # and so does what is made of them
        moving = read_moving_rig(tmp_path / name)
        head, foot = (moving.position[:, k] for k in (3, -1))
        assert ((head - foot)[:, 1] > 1).all()


@pytest.mark.parametrize("up", WORLDS)
def test_results_stay_in_the_world_of_the_capture(up: str, tmp_path: Path) -> None:
    found = performance(WORLDS[up])
    found.save(tmp_path)
    result = read_result(tmp_path)
    assert np.abs(result.bone_transforms - found.bone_transforms()).max() < 1e-5
    assert np.abs(result.joints - found.joints().numpy()).max() < 1e-9
    template, original = load_template(tmp_path / "capture.glb"), found.actor.template
    assert np.abs(template.vertices - original.vertices).max() < 1e-5
    assert np.abs(template.bone_rest - original.bone_rest).max() < 1e-5


def test_up_may_be_known_of_somebody_who_lies(tmp_path: Path) -> None:
    lying = performance(WORLDS["z"])
    write_result(lying, tmp_path, up=axis("y"))
    (scene,) = open_document(tmp_path / "capture.glb").tree["scenes"]
    nodes = open_document(tmp_path / "capture.glb").tree["nodes"]
    assert not any("extras" in nodes[number] for number in scene["nodes"])
    bones = (lying.bone_transforms() @ lying.actor.template.bone_rest)[..., :3, 3]
    assert np.abs(played(tmp_path / "capture.glb") - bones).max() < 1e-5


def given(body: Performance) -> Person:
    """Somebody with exact detections of where they are."""
    return Person(body.actor, detect(body.actor, body.cameras, body.motion))


def test_people_of_one_scene_have_one_up(tmp_path: Path) -> None:
    """Whoever lay beside others was saved standing, in a world turned aside from theirs."""
    standing, lying = (performance(WORLDS[up]) for up in "yz")
    away = lying.motion.translation + torch.tensor([2.0, 0.0, 0.0])  # nobody is in anybody
    lying = replace(lying, motion=replace(lying.motion, translation=away), surface=None)
    lying = replace(lying, cameras=standing.cameras)
    scene = Scene(standing.cameras, (given(standing), given(lying)), standing.rate)
    with torch.no_grad():
        found = capture(scene, until=Stage.INITIALIZE)
    assert upright(found[1].joints())[1] == 0
    for each in found:
        assert each.up is not None and each.up.tolist() == [0, 1, 0]
    found[1].save(tmp_path)
    assert not turned(tmp_path / "capture.glb")


@pytest.mark.parametrize("about", [{"level": True}, {"up": torch.tensor([0.2, 1.0, 0.1])}])
def test_what_is_known_of_up_is_kept(about: dict[str, Any]) -> None:
    body = performance(WORLDS["y"])
    person = given(body)
    parts = body.cameras, person.detections, body.rate
    with torch.no_grad():
        found = capture(body.actor, *parts, until=Stage.INITIALIZE, **about)
    assert found.up is not None and found.up.tolist() == [0, 1, 0]
    assert found.to(torch.zeros(1)).up is not None
    assert capture(body.actor, *parts, until=Stage.INITIALIZE).up is None


def turned(path: Path) -> bool:
    """Whether a scene has a node above its bones that turns them."""
    tree = open_document(path).tree
    (scene,) = tree["scenes"]
    return any("extras" in tree["nodes"][number] for number in scene["nodes"])
