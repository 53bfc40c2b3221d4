"""Parts of the body: whole, on their side, and where the picture shows them."""

import numpy as np
import pytest
import torch
from motion_files import write_library

from perfcap.actor.anatomy import JOINTS
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.body_model import load_body_model
from perfcap.train.augment import Framing, cut
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.body_parts import PARTS, UNKNOWN, face_parts, mirrored_parts
from perfcap.train.cast import Cast
from perfcap.train.config import SceneData
from perfcap.train.figure import Figure, actor_figure
from perfcap.train.motion_library import MotionLibrary
from perfcap.train.scenes import Scenes, Shot

DATA = SceneData(
    size=128, group=8, places=1, texture=32, shadowed=0.0, occluded=0.0, empty=0.0, skirts=0.0
)


@pytest.fixture(scope="module")
def figure() -> Figure:
    return actor_figure(load_body_model().actor(torch.zeros(0, dtype=torch.float64)), 32)


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> list[Shot]:
    library = MotionLibrary.read(write_library(tmp_path_factory.mktemp("motion"), frames=30))
    return Scenes(Cast(load_body_model(), (), library, DATA), Backgrounds(), DATA, 0).group(0)


def test_every_face_has_the_part_that_it_lies_in(figure: Figure) -> None:
    parts = face_parts(figure.vertices, figure.faces, figure.owner)
    middle = figure.vertices[figure.faces].mean(1)
    names = np.array(PARTS)[parts.numpy()]
    bare = {name for name in PARTS if name != "background" and not name.startswith("skirt")}
    assert set(names) == bare
    for side, sign in (("l", 1), ("r", -1)):
        limbs = [name.startswith(f"{side}_") for name in names]
        assert (sign * middle[limbs, 0] > -0.03).all()  # left is +x
    for part in ("head", "trunk"):
        front, back = (middle[names == f"{part}_{half}", 2] for half in ("front", "back"))
        assert front.min() > back.max() - 0.03
    ankle = figure.joints[JOINTS.index("l_ankle"), 1]
    assert (middle[names == "l_foot", 1] < ankle + 0.08).all()


def test_the_map_shows_parts_at_their_joints(shots: list[Shot]) -> None:
    hits = []
    for shot in shots:
        assert shot.parts.shape == (32, 32)
        for joint, part in (("wrist", ("forearm", "hand")), ("knee", ("thigh", "shank"))):
            for side in "lr":
                x, y = (shot.joints2d[LANDMARKS.index(f"{side}_{joint}")] / 4).round().astype(int)
                near = shot.parts[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2]
                hits.append(bool(set(near.ravel()) & {PARTS.index(f"{side}_{p}") for p in part}))
    assert np.mean(hits) > 0.6  # others are behind the body or a skirt


def test_parts_go_with_the_picture(shots: list[Shot]) -> None:
    # what is bright in the picture is a part in the map, however both are cut
    parts = np.zeros((32, 32), np.uint8)
    parts[10:20, 6:12] = PARTS.index("l_thigh")
    image = np.repeat(np.repeat(255 * (parts > 0), 4, 0), 4, 1)[..., None].repeat(3, 2)
    shot = Shot(image.astype(np.uint8), shots[0].joints2d, shots[0].joints3d, 200.0, True, parts)
    for framing in (Framing(), Framing(1.2, 0.5, (0.1, -0.05)), Framing(0.9, -0.4, mirror=True)):
        view = cut(shot, framing, 128, 1.8)
        small = view.image[..., 0].reshape(32, 4, 32, 4).mean((1, 3))
        clear = (small < 20) | (small > 235)
        name = "r_thigh" if framing.mirror else "l_thigh"
        expected = np.where(small > 127, PARTS.index(name), 0)
        assert clear.mean() > 0.9 and (view.parts == expected)[clear].all()


def test_a_mirror_exchanges_sides() -> None:
    table = mirrored_parts()
    assert (table[table] == np.arange(256)).all() and table[UNKNOWN] == UNKNOWN
    assert PARTS[table[PARTS.index("l_hand")]] == "r_hand"
    assert PARTS[table[PARTS.index("trunk_back")]] == "trunk_back"
