"""URDF and MJCF humanoids as actors, and files that want to do harm."""

import math
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import robots
import torch
import trimesh

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.motion import Motion
from perfcap.actor.sole_points import sole_skeleton
from perfcap.errors import InputError
from perfcap.io.actor import load_actor
from perfcap.io.robot import load_robot
from perfcap.io.robot.load import read_robot
from perfcap.io.robot.urdf import mesh_file

F64 = torch.float64


def test_both_formats_are_the_same_robot(tmp_path: Path) -> None:
    files = robots.write(tmp_path)
    one, other = (load_robot(files[kind]).skeleton.rig for kind in ("urdf", "xml"))
    assert one.joints == other.joints and one.parents == other.parents
    # the MJCF is drawn at a height; rigs are compared from their roots
    apart = (one.positions - one.positions[0]) - (other.positions - other.positions[0])
    assert apart.abs().max() < 1e-12
    assert [h.name for h in one.hinges] == [h.name for h in other.hinges]
    limits_of = {name: limits for name, _, limits in robots.HINGES}
    assert sorted(h.name for h in one.hinges) == sorted(limits_of)
    for mine, theirs in zip(one.hinges, other.hinges, strict=True):
        limits = limits_of[mine.name]
        assert mine.joint == theirs.joint
        assert np.allclose(mine.axis, theirs.axis, atol=1e-12)
        assert np.allclose((mine.lower, mine.upper), np.radians(limits))
        assert np.allclose((theirs.lower, theirs.upper), np.radians(limits))
    names = dict(zip(JOINTS, (one.joints[role] for role in one.roles), strict=True))
    assert names["pelvis"] == "base" and names["spine"] == "chest" and names["head"] == "head"
    assert names["l_hip"] == "left_thigh" and names["r_ankle"] == "right_foot"
    assert names["r_shoulder"] == "right_upper_arm" and names["l_wrist"] == "left_hand"


def test_kinematics_is_that_of_the_file(tmp_path: Path) -> None:
    """Against products of the file's own numbers, at random angles and turns of the root."""
    actor = load_robot(robots.write(tmp_path)["xml"])
    skeleton, random = actor.skeleton, torch.Generator().manual_seed(3)
    share = torch.rand(4, len(robots.HINGES), generator=random, dtype=F64)
    angles = skeleton.lower + share * (skeleton.upper - skeleton.lower)
    turn = torch.randn(4, 3, generator=random, dtype=F64)
    found = actor.bone_transforms(Motion(torch.zeros(4, 3, dtype=F64), turn, angles))
    bones = found.numpy() @ actor.template.bone_rest
    names = list(skeleton.angle_names)
    to_file = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # y up, facing z, to z up, facing x
    for frame in range(4):
        row = np.zeros(7 + len(names))
        base = to_file @ bones[frame, 0, :3, :3]
        row[3:7] = robots.Rotation.from_matrix(base).as_quat(scalar_first=True)
        row[7:] = angles[frame]
        expected = robots.posed(row, names)
        for index, name in enumerate(skeleton.rig.joints):
            pose = bones[frame, index]
            assert np.allclose(to_file @ pose[:3, 3], expected[name][:3, 3], atol=1e-9)
            assert np.allclose(to_file @ pose[:3, :3], expected[name][:3, :3], atol=1e-9)


def test_soles_are_under_the_feet(tmp_path: Path) -> None:
    actor = load_robot(robots.write(tmp_path)["urdf"])
    soles = sole_skeleton(actor).rest_landmarks[-8:]
    ankle = actor.skeleton.rest_positions[actor.skeleton.rig.roles[JOINTS.index("l_ankle")]]
    assert torch.allclose(soles[:, 1], ankle[1] - 0.05, atol=1e-9)
    ahead = soles[:4, 2] - ankle[2]
    assert ahead.min() == pytest.approx(-0.05) and ahead.max() == pytest.approx(0.17)
    assert soles[:4, 0].mean() > 0 > soles[4:, 0].mean()  # left is +x


def test_several_places_of_hinges_in_one_body(tmp_path: Path) -> None:
    """MJCF lets hinges of one body be apart, as ankles are; each place becomes a joint."""
    text = robots.mjcf().replace(
        '<joint name="left_ankle_pitch" axis="0 1 0"',
        '<joint name="left_extra" axis="1 0 0" pos="0 0 0.1" range="-10 10"/>'
        '<joint name="left_ankle_pitch" axis="0 1 0"',
    )
    path = tmp_path / "walker.xml"
    path.write_text(text)
    actor = load_robot(path)
    rig = actor.skeleton.rig
    extra = rig.joints.index("left_ankle.left_extra")
    body = rig.joints.index("left_ankle")
    assert rig.parents[body] == extra
    up = rig.positions[extra] - rig.positions[body]
    assert torch.allclose(up, torch.tensor([0.0, 0.1, 0.0], dtype=F64), atol=1e-12)


def test_mjcf_orientations_units_and_references(tmp_path: Path) -> None:
    """Ways of writing a turn agree; radians, unlimited joints and a reference angle are read."""
    turns = {
        'euler="0 0 90"': "degree", 'axisangle="0 0 1 90"': "degree",
        'quat="1 0 0 1"': "degree", 'xyaxes="0 1 0 -1 0 0"': "degree",
        f'euler="0 0 {math.pi / 2}"': "radian",
    }  # fmt: skip
    for turn, unit in turns.items():
        path = tmp_path / "arm.xml"
        path.write_text(
            f'<mujoco><compiler angle="{unit}"/><worldbody><body name="a"><freejoint/>'
            f'<body name="b" {turn} pos="1 0 0"><joint name="j" ref="0.5"/></body></body>'
            "</worldbody></mujoco>"
        )
        body = read_robot(path).bodies[1]
        assert np.allclose(body.pose[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-9)
        hinge = body.hinges[0]
        assert hinge.lower == -math.inf and hinge.upper == math.inf
        assert hinge.rest == pytest.approx(0.5 if unit == "radian" else math.radians(0.5))


def test_mjcf_turns_about_axes_in_any_order(tmp_path: Path) -> None:
    """Small letters turn axes that turn along, capitals those of the parent."""
    path, angles = tmp_path / "arm.xml", (20, -50, 110)
    for order in ("xyz", "zyx", "XYZ", "zxz"):
        path.write_text(
            f'<mujoco><compiler eulerseq="{order}"/><worldbody><body name="a"><freejoint/>'
            f'<body name="b" euler="{robots.words(angles)}"><joint/></body></body></worldbody>'
            "</mujoco>"
        )
        # scipy has it the other way round: capitals for axes that turn along
        expected = robots.Rotation.from_euler(order.swapcase(), angles, degrees=True).as_matrix()
        assert np.allclose(read_robot(path).bodies[1].pose[:3, :3], expected, atol=1e-9)


def test_mjcf_takes_the_axes_of_a_mesh_away_before_it_is_scaled(tmp_path: Path) -> None:
    """Ends of the box are those that MuJoCo 3 has."""
    box = trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, 3]])
    box.export(tmp_path / "box.stl")
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><asset><mesh name="m" file="box.stl" refpos="1 0 0" refquat="1 0 0 1" '
        'scale="1 1 2"/></asset><worldbody><body name="a"><freejoint/>'
        '<geom type="mesh" mesh="m"/><body name="b"><joint/></body></body></worldbody></mujoco>'
    )
    ((vertices, _),) = read_robot(path).bodies[0].shapes
    assert np.allclose([vertices.min(0), vertices.max(0)], [[0, 0, 0], [2, 1, 6]])


def test_mapping_names_bodies(tmp_path: Path) -> None:
    path = tmp_path / "walker.urdf"
    path.write_text(robots.urdf().replace("left_shin", "left_x").replace("left_knee", "left_y"))
    with pytest.raises(InputError, match=r"finds no body for pelvis.*l_hip, l_knee"):
        load_robot(path)
    mapping = tmp_path / "map.toml"
    mapping.write_text('l_knee = "left_x"')
    rig = load_actor(path, mapping, robots=True).skeleton.rig
    assert rig.joints[rig.roles[JOINTS.index("l_hip")]] == "left_thigh"
    mapping.write_text('l_knee = "nothing"')
    with pytest.raises(InputError, match="no body nothing"):
        load_actor(path, mapping, robots=True)


def test_mapping_says_nothing_else_of_robots(tmp_path: Path) -> None:
    path, mapping = robots.write(tmp_path)["urdf"], tmp_path / "map.toml"
    for line in ("metres_per_unit = 0.001", 'head_top = "head"'):
        mapping.write_text(line)
        with pytest.raises(InputError, match=f"{line.split()[0]} cannot be said of a robot"):
            load_actor(path, mapping, robots=True)


def test_frames_are_part_of_what_is_in_them(tmp_path: Path) -> None:
    """A frame moves bodies, joints and shapes as if they had been written so."""
    place, inner = "0.1 0.2 0.3", "0 0 0.5"
    frame = f'<frame pos="{place}" euler="0 0 90">'
    joint, geom = '<joint name="j" axis="1 0 0" pos="0 0.1 0"/>', '<geom size="0.1" pos="1 0 0"/>'
    moved = {
        f'{frame}<body name="b" pos="{inner}">{joint}{geom}</body></frame>':
            ([0.1, 0.2, 0.8], [0, 0.1, 0], [1, 0, 0], [1, 0, 0]),
        f'<body name="b" pos="{inner}">{frame}{joint}{geom}</frame></body>':
            ([0, 0, 0.5], [0, 0.2, 0.3], [0, 1, 0], [0.1, 1.2, 0.3]),
    }  # fmt: skip
    path = tmp_path / "arm.xml"
    for text, (at, anchor, axis, middle) in moved.items():
        path.write_text(
            f'<mujoco><worldbody><frame><body name="a"><freejoint/>{text}</body></frame>'
            "</worldbody></mujoco>"
        )
        body = read_robot(path).bodies[1]
        np.testing.assert_allclose(body.pose[:3, 3], at, atol=1e-12)
        np.testing.assert_allclose(body.hinges[0].anchor, anchor, atol=1e-12)
        np.testing.assert_allclose(body.hinges[0].axis, axis, atol=1e-12)
        np.testing.assert_allclose(body.shapes[0][0].mean(0), middle, atol=1e-3)


def test_what_a_file_says_and_nothing_here_does_is_noted(tmp_path: Path) -> None:
    knee = '<joint name="right_knee" type="revolute">'
    mimic = robots.urdf().replace(knee, f'{knee}<mimic joint="left_knee"/>')
    coupled = '<equality><joint joint1="right_knee" joint2="left_knee"/></equality>'
    several = {
        "a.urdf": (mimic, r"joints right_knee follow others \(<mimic>\)"),
        "a.xml": (robots.mjcf().replace("</mujoco>", f"{coupled}</mujoco>"), "right_knee follow"),
        "b.urdf": (re.sub(r"<limit[^>]*>", "", robots.urdf(), count=1), "have no <limit>"),
        "b.xml": (robots.mjcf().replace('"degree"', '"radian"'), "look like degrees"),
        "c.xml": (re.sub('range="[^"]*"', 'range="-1.5 2"', robots.mjcf()), "limits in radians"),
    }
    for name, (text, words) in several.items():
        (tmp_path / name).write_text(text)
        (note,) = read_robot(tmp_path / name).notes
        assert re.search(words, note)
    plain = robots.write(tmp_path)
    assert not any(read_robot(path).notes for path in plain.values())


def test_robots_in_millimetres_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    place = re.compile('xyz="([^"]*)"(?=/><axis)')
    for scale, unit in ((1000, "millimetres"), (100, "centimetres")):
        path.write_text(place.sub(partial(times, scale), robots.urdf()))
        with pytest.raises(InputError, match=rf"a.urdf: its bodies lie .* {unit} by {scale}"):
            load_robot(path)
    (tmp_path / "foot.obj").write_text("v 0 0 0\nv 220 0 0\nv 0 90 0\nf 1 2 3\n")
    mesh = '<mesh filename="foot.obj"/>'
    path.write_text(re.sub("<box[^>]*/>", mesh, robots.urdf()))
    with pytest.raises(InputError, match="a shape of 'left_foot' is 220 across"):
        load_robot(path)
    scaled = mesh.replace("/>", ' scale="0.001 0.001 0.001"/>')
    path.write_text(re.sub("<box[^>]*/>", scaled, robots.urdf()))
    load_robot(path)


def times(scale: float, found: re.Match[str]) -> str:
    return f'xyz="{robots.words(scale * np.array(found[1].split(), float))}"'


@pytest.mark.parametrize("name", ["package://bot/arm.obj", "package:///bot/arm.obj", "arm.obj"])
def test_meshes_of_a_package(name: str, tmp_path: Path) -> None:
    """Three slashes too, as some published robots (Talos) write them."""
    folder = tmp_path / "bot"
    folder.mkdir()
    (folder / "arm.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert mesh_file(folder / "bot.urdf", name).resolve() == (folder / "arm.obj").resolve()
    with pytest.raises(InputError, match="lies outside of"):
        mesh_file(folder / "bot.urdf", "package:///../../arm.obj")


HOSTILE = {
    '<mujoco><worldbody><body name="ball"><freejoint/></body><body name="a"><freejoint/>'
    '<body><joint type="hinge"/></body></body></worldbody></mujoco>': "2 bodies with joints",
    '<mujoco><worldbody><body><freejoint/><attach model="m" body="b" prefix="p"/></body>'
    "</worldbody></mujoco>": "mj_saveLastXML",
    '<!DOCTYPE r [<!ENTITY a "aaaa">]><robot name="&a;"/>': "document type or entities",
    "<robot>" + "<a>" * 200 + "</a>" * 200 + "</robot>": "nested more than",
    "<robot>" + "<a/>" * 30_000 + "</robot>": "more than 20000 elements",
    "<robot": "is no XML",
    "<gltf/>": "expected a URDF's <robot>",
    "<robot/>": "has 0 links",
    '<mujoco><include file="/etc/passwd"/></mujoco>': "lies outside of",
    '<mujoco><include file="../up.xml"/></mujoco>': "lies outside of",
    '<mujoco><include file="robot.xml"/></mujoco>': "or one by itself",
    '<mujoco><compiler meshdir="/"/></mujoco>': "lies outside of",
    '<mujoco><worldbody><body><freejoint/><body><joint type="slide"/></body></body>'
    "</worldbody></mujoco>": "'slide', expected hinges",
    '<mujoco><worldbody><body><freejoint/><body><joint type="free"/></body></body>'
    "</worldbody></mujoco>": "'free', expected hinges",
    '<mujoco><worldbody><body><joint type="hinge"/><body><joint/></body></body>'
    "</worldbody></mujoco>": "'hinge', expected a free joint",
    '<mujoco><compiler eulerseq="xyzx"/></mujoco>': "expected three axes",
    '<mujoco><compiler eulerseq="xyw"/></mujoco>': "expected three axes",
    '<mujoco><worldbody><body><joint type="free"/><body pos="1 2 nan"><joint/></body></body>'
    "</worldbody></mujoco>": "expected 3 numbers",
    '<robot><link name="a"><collision><geometry><mesh filename="package://x/../../y.stl"/>'
    "</geometry></collision></link></robot>": "lies outside of",
    '<robot><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
    '<child link="b"/><axis xyz="0 0 0"/><limit lower="0" upper="1"/></joint></robot>':
    "no direction",
    '<robot><link name="a"/><link name="b"/><joint name="j" type="fixed"><parent link="a"/>'
    '<child link="b"/></joint><joint name="k" type="fixed"><parent link="b"/>'
    '<child link="b"/></joint></robot>': "joins no two links",
}  # fmt: skip


@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_hostile_files(text: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=HOSTILE[text]):
        load_robot(path)


def test_large_and_strange_files(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_bytes(b" " * (5 * 2**20))
    with pytest.raises(InputError, match="the limit for a URDF or MJCF"):
        load_robot(path)
    path.write_bytes('<?xml version="1.0" encoding="UTF-16"?><robot/>'.encode("utf-16"))
    with pytest.raises(InputError, match="not UTF-8"):
        load_robot(path)


def test_robots_are_no_actors_of_captures(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"perfcap retarget FOLDER --actor walker\.urdf"):
        load_actor(robots.write(tmp_path)["urdf"])
