"""Bodies, clothes and poses of rendered people."""

from pathlib import Path

import numpy as np
import pytest
import torch
from motion_files import write_library

from perfcap.actor.anatomy import JOINTS
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io import load_actor
from perfcap.io.body_model import load_body_model
from perfcap.train.cast import Cast
from perfcap.train.config import SceneData
from perfcap.train.figure import (
    Figure,
    Skirt,
    actor_figure,
    hang,
    pose_figure,
    rest_turns,
    skirt_mesh,
)
from perfcap.train.motion_library import MotionLibrary, smallest_turn
from perfcap.train.wardrobe import SKIN, Wardrobe, random_outfit

BONES = [
    (f"{s}_{a}", f"{s}_{b}")
    for s in "lr"
    for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"),
                 ("ankle", "toe"))
]  # fmt: skip


@pytest.fixture(scope="module")
def figure() -> Figure:
    return actor_figure(load_body_model().actor(torch.zeros(0).double()), 64)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    return MotionLibrary.read(write_library(tmp_path_factory.mktemp("motion"), frames=30))


def directions(points: torch.Tensor) -> torch.Tensor:
    ends = [[LANDMARKS.index(name) for name in bone] for bone in BONES]
    along = torch.stack([points[b] - points[a] for a, b in ends])
    return along / along.norm(dim=-1, keepdim=True)


def test_without_turns_a_figure_stands_in_a_t_pose(figure: Figure) -> None:
    straight = torch.eye(3).expand(16, 3, 3)
    marks = pose_figure(figure, figure.vertices, straight, rest_turns(figure))[1]
    expected = [(1, 0, 0), (1, 0, 0), (0, -1, 0), (0, -1, 0), (0, 0, 1)]
    expected += [(-1, 0, 0), (-1, 0, 0), (0, -1, 0), (0, -1, 0), (0, 0, 1)]
    torch.testing.assert_close(directions(marks), torch.tensor(expected).float(), atol=1e-5, rtol=0)


@pytest.mark.parametrize("who", ["ada", "sam"])
def test_figures_move_as_people_do(figure: Figure, library: MotionLibrary, who: str) -> None:
    moved = figure if who == "ada" else actor_figure(load_actor("sam"), 64)
    rest = rest_turns(moved)
    for frame in (0, 17):
        recording = library.recordings[1]
        surface, marks = pose_figure(moved, moved.vertices, recording.turns[frame], rest)
        along = (directions(marks) * directions(recording.landmarks[frame])).sum(-1)
        assert along.min() > 0.9999
        # the surface goes with its joints
        crown = surface[moved.vertices[:, 1].argmax()] - marks[LANDMARKS.index("head_top")]
        assert crown.norm() < 0.12


def test_smallest_turns() -> None:
    generator = np.random.default_rng(0)
    for _ in range(20):
        start, end = generator.normal(size=(2, 3))
        turn = smallest_turn(start, end)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        ahead = turn @ start / np.linalg.norm(start)
        np.testing.assert_allclose(ahead, end / np.linalg.norm(end), atol=1e-12)
    for end in (-start, 0 * start):
        np.testing.assert_array_equal(smallest_turn(start, end), np.eye(3))


def test_clothes_cover_and_are_repeatable(figure: Figure) -> None:
    wardrobe = Wardrobe.of(figure)
    outfit = random_outfit(np.random.default_rng(3))
    one, two = (wardrobe.dress(figure, outfit, np.random.default_rng(4)) for _ in range(2))
    assert torch.equal(one.vertices, two.vertices) and np.array_equal(one.texture, two.texture)
    grown = (one.vertices - figure.vertices).norm(dim=-1)
    assert 0 < grown.max() < 0.06 and torch.equal(one.faces, figure.faces)
    hands = torch.isin(figure.owner, torch.tensor([JOINTS.index(f"{s}_wrist") for s in "lr"]))
    assert grown[hands].median() == outfit.thickness[SKIN]
    assert one.texture.shape == figure.texture.shape and one.texture.std() > 10


def test_skirts_go_around_the_legs(figure: Figure) -> None:
    skirt = Skirt(0.1, 0.7, flare=0.1, folds=6, depth=0.0, phase=0.0, sway=(0.0, 0.0))
    straight = torch.eye(3).expand(16, 3, 3)
    surface, marks = pose_figure(figure, figure.vertices, straight, rest_turns(figure))
    hips = marks[[LANDMARKS.index("l_hip"), LANDMARKS.index("r_hip")]].mean(0)
    cloth = hang(skirt, figure, surface, hips, straight[0]) - hips
    thighs = torch.isin(figure.owner, torch.tensor([JOINTS.index(f"{s}_knee") for s in "lr"]))
    legs = (surface - hips)[thighs]
    legs = legs[legs[:, 1] > -0.55]
    for point in legs[::20]:
        level = cloth[(cloth[:, 1] - point[1]).abs() < 0.06]
        along = level[:, [0, 2]] @ point[[0, 2]] / point[[0, 2]].norm()
        assert along.max() > point[[0, 2]].norm()
    faces, uv = skirt_mesh()
    assert int(faces.max()) == len(cloth) - 1 == len(uv) - 1
    assert uv.min() >= 0 and uv.max() <= 1


def test_a_cast_never_repeats_itself_but_can(library: MotionLibrary) -> None:
    cast = Cast(load_body_model(), (), library, SceneData(texture=32, skirts=1.0))
    poses = []
    for seed in (5, 5, 6):
        rng = np.random.default_rng(seed)
        person = cast.person(rng)
        posed = cast.pose(person, rng)
        assert posed.vertices.isfinite().all() and int(posed.faces.max()) < len(posed.vertices)
        places, corners = cast.texture_places(person)
        assert len(corners) == len(posed.faces) and int(corners.max()) < len(places)
        poses.append(posed.landmarks)
    assert torch.equal(poses[0], poses[1]) and not torch.equal(poses[0], poses[2])


def test_sides_stay_sides(library: MotionLibrary) -> None:
    """Also of poses that were mirrored: left is left of a person who looks ahead."""
    still = SceneData(texture=32, loosened=0.0, recombined=0.0, tilted=0.0, skirts=0.0)
    cast = Cast(load_body_model(), (), library, still)
    rng = np.random.default_rng(0)
    person = cast.person(rng)
    toes = [LANDMARKS.index(f"{s}_{part}") for part in ("ankle", "toe") for s in "lr"]
    for _ in range(12):
        marks = cast.pose(person, rng).landmarks
        feet = marks[toes]
        ahead = (feet[2:] - feet[:2]).mean(0)
        up = marks[LANDMARKS.index("neck")] - marks[[8, 12]].mean(0)
        left = torch.linalg.cross(up, ahead)
        hips = marks[LANDMARKS.index("l_hip")] - marks[LANDMARKS.index("r_hip")]
        assert left @ hips > 0


def test_people_may_be_made_to_face_the_camera(library: MotionLibrary) -> None:
    """Cameras stand on +z: whoever faces them has the left hand on their right."""
    data = SceneData(texture=32, loosened=0.0, tilted=0.0, skirts=0.0, facing=1.0)
    cast = Cast(load_body_model(), (), library, data)
    rng = np.random.default_rng(1)
    person = cast.person(rng)
    hips = [LANDMARKS.index("l_hip"), LANDMARKS.index("r_hip")]
    for _ in range(12):
        left, right = cast.pose(person, rng).landmarks[hips]
        assert left[0] > right[0] - 0.03


def test_the_library_may_lie_anywhere(tmp_path: Path) -> None:
    library = MotionLibrary.read(write_library(tmp_path / "motion", people=1, frames=5))
    turns = library.recordings[0].turns
    assert turns.shape == (5, len(JOINTS), 3, 3)
    torch.testing.assert_close(turns @ turns.mT, torch.eye(3).expand_as(turns), atol=1e-5, rtol=0)
