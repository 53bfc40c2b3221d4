"""BVH: angles without flips, round trips, real clips, malformed text."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perfcap.actor.template import Template
from perfcap.errors import InputError
from perfcap.io.bvh_read import BvhMotion, bvh_motion, joint_positions, load_bvh
from perfcap.io.bvh_write import euler_angles, save_bvh

CLIPS = Path(__file__).parents[2] / "../shared/data/mocap_cmu_bvh"
ORDERS = ("ZXY", "ZYX", "XYZ", "XZY", "YXZ", "YZX")


def wandering(frames: int, joints: int, step: float = 0.2) -> np.ndarray:
    """Rotations that drift through many turns in small steps, (frames, joints, 3, 3)."""
    steps = np.random.default_rng(3).normal(0, step, (frames, joints, 3))
    steps[:, :, 1] += 0.1
    turns = np.empty((frames, joints, 3, 3))
    current = np.tile(np.eye(3), (joints, 1, 1))
    for frame in range(frames):
        current = Rotation.from_rotvec(steps[frame]).as_matrix() @ current
        turns[frame] = current
    return turns


def motion(frames: int = 20) -> BvhMotion:
    """Five joints, named so that depth-first order differs from theirs."""
    offsets = np.array([[0, 0.9, 0], [0, 0.4, 0], [0.1, 0, 0], [0, 0.3, 0.1], [0, -0.4, 0]])
    positions = np.tile(offsets, (frames, 1, 1))
    positions[:, 0] += 0.1 * np.random.default_rng(4).normal(size=(frames, 3))
    return BvhMotion(
        names=("hips", "spine", "l_hip", "head", "l_knee"),
        parents=np.array([-1, 0, 0, 1, 2]),
        offsets=offsets,
        rotations=wandering(frames, 5),
        positions=positions,
        frame_time=1 / 30,
    )


@pytest.mark.parametrize("order", ORDERS)
def test_angles_rebuild_the_rotation_and_agree_with_scipy(order: str) -> None:
    rotations = Rotation.random(60, rng=np.random.default_rng(0)).as_matrix()
    angles = euler_angles(rotations[:, None], order)[:, 0]
    np.testing.assert_allclose(
        Rotation.from_euler(order, angles).as_matrix(), rotations, atol=1e-12
    )
    first = Rotation.from_matrix(rotations[0]).as_euler(order)
    np.testing.assert_allclose(angles[0], first, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_angles_do_not_jump(order: str) -> None:
    """A slow turn about each single axis passes 180 degrees without a flip."""
    turn = np.linspace(0, 6 * np.pi, 200)
    for axis in range(3):
        vector = np.zeros((200, 3))
        vector[:, axis] = turn
        rotations = Rotation.from_rotvec(vector).as_matrix()
        angles = euler_angles(rotations[:, None], order)[:, 0]
        assert np.abs(np.diff(angles, axis=0)).max() < 0.2
        assert np.ptp(angles) == pytest.approx(6 * np.pi)


def test_gimbal_lock_is_exact_and_keeps_the_last_angle() -> None:
    angles = np.array([[0.3, 0.2, 0.5], [0.3, np.pi / 2, 0.5], [0.4, np.pi / 2, 0.5]])
    rotations = Rotation.from_euler("ZXY", angles[:1]).as_matrix()
    locked = [euler_matrix(row) for row in angles[1:]]
    found = euler_angles(np.concatenate([rotations, locked])[:, None])[:, 0]
    np.testing.assert_allclose(found, angles, atol=1e-7)


def euler_matrix(angles: np.ndarray) -> np.ndarray:
    one, two, three = (
        Rotation.from_euler(axis, angle).as_matrix()
        for axis, angle in zip("ZXY", angles, strict=True)
    )
    return one @ two @ three


@pytest.mark.parametrize("order", ["ZXY", "ZYX"])
@pytest.mark.parametrize("unit", [0.01, 1.0])
def test_a_saved_motion_reads_back(order: str, unit: float, tmp_path: Path) -> None:
    given, path = motion(), tmp_path / "a.bvh"
    save_bvh(path, given, unit, order)
    back = load_bvh(path, unit)
    assert back.names == ("hips", "spine", "head", "l_hip", "l_knee")
    order_back = [back.names.index(name) for name in given.names]
    np.testing.assert_allclose(back.rotations[:, order_back], given.rotations, atol=1e-7)
    np.testing.assert_allclose(
        joint_positions(back)[:, order_back], joint_positions(given), atol=2e-6
    )
    assert back.frame_time == pytest.approx(given.frame_time, rel=1e-7)
    np.testing.assert_allclose(back.offsets[order_back][1:], given.offsets[1:], atol=1e-6)


def test_only_moving_joints_have_position_channels(tmp_path: Path) -> None:
    given, path = motion(), tmp_path / "a.bvh"
    save_bvh(path, given)
    assert path.read_text().count("Xposition") == 1
    positions = given.positions.copy()
    positions[:, 3, 1] += np.linspace(0, 0.1, len(positions))
    save_bvh(path, replace(given, positions=positions))
    assert path.read_text().count("Xposition") == 2
    np.testing.assert_allclose(load_bvh(path).positions[:, 2], positions[:, 3], atol=1e-7)


def test_joints_turn_about_the_axes_whose_angles_move_least(tmp_path: Path) -> None:
    """An arm raised about x, swaying a little, passes near the pole of orders with x between."""
    given, path = motion(), tmp_path / "a.bvh"
    sway = 0.05 * np.sin(np.linspace(0, 20, len(given.rotations)))
    raised = np.stack((np.linspace(1.0, 2.1, len(sway)), sway, 0.05 - sway), 1)
    rotations = given.rotations.copy()
    rotations[:, 2] = Rotation.from_euler("XYZ", raised).as_matrix()
    save_bvh(path, replace(given, rotations=rotations))
    channels = path.read_text().split("JOINT l_hip")[1].split("CHANNELS 3 ")[1].split()[:3]
    assert channels[1] != "Xrotation"
    back = load_bvh(path)
    hip = back.names.index("l_hip")
    np.testing.assert_allclose(back.rotations[:, hip], rotations[:, 2], atol=1e-7)


def test_tips_are_kept(tmp_path: Path) -> None:
    ends = np.full((5, 3), np.nan)
    ends[3], ends[4] = (0, 0.2, 0), (0, 0, 0.1)
    save_bvh(tmp_path / "a.bvh", replace(motion(), ends=ends))
    back = load_bvh(tmp_path / "a.bvh")
    assert back.ends is not None
    np.testing.assert_allclose(back.ends[[2, 4]], ends[[3, 4]], atol=1e-7)
    assert np.isnan(back.ends[[0, 1, 3]]).all()


def test_bone_transforms_become_joint_motion() -> None:
    rest = np.tile(np.eye(4), (2, 1, 1))
    rest[:, :3, 3] = [[0, 1, 0], [0, 1.5, 0.1]]
    rest[:, :3, :3] = Rotation.random(2, rng=np.random.default_rng(2)).as_matrix()
    template = Template(
        vertices=np.eye(3), faces=np.array([[0, 1, 2]]), bone_names=("a", "b"),
        bone_parents=np.array([-1, 0]), bone_rest=rest,
        weight_bones=np.zeros((3, 1), dtype=int), weights=np.ones((3, 1)),
    )  # fmt: skip
    transforms = np.tile(np.eye(4), (4, 2, 1, 1))
    transforms[:, :, :3, :3] = wandering(4, 2)
    transforms[:, 0, :3, 3] = np.random.default_rng(1).normal(size=(4, 3))
    hinge = rest[1, :3, 3]  # the child turns about its own origin, carried by the parent
    carried = transforms[:, 0, :3, :3] @ hinge + transforms[:, 0, :3, 3]
    transforms[:, 1, :3, 3] = carried - transforms[:, 1, :3, :3] @ hinge
    found = bvh_motion(template, transforms, 25)
    posed = (transforms @ rest)[..., :3, 3]
    np.testing.assert_allclose(joint_positions(found), posed, atol=1e-12)
    np.testing.assert_allclose(found.positions[:, 1], np.tile([0, 0.5, 0.1], (4, 1)), atol=1e-12)
    assert found.frame_time == 0.04


@pytest.mark.parametrize(
    "changes",
    [
        {"offsets": np.zeros((4, 3))},
        {"positions": np.full((20, 5, 3), np.nan)},
        {"parents": np.array([-1, -1, 0, 1, 2])},
        {"parents": np.array([-1, 2, 1, 1, 2])},
        {"frame_time": 0.0},
    ],
)
def test_bad_motion_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(InputError):
        replace(motion(), **changes)  # type: ignore[arg-type]


TEXT = """HIERARCHY
ROOT hips
{ OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT leg
  { OFFSET 0 -1 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    { OFFSET 0 -1 0 } } }
MOTION
Frames: 2
Frame Time: 0.1
1 2 3 90 0 0 0 0 0
1 2 3 0 0 0 0 90 0
"""


def test_known_text(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    path.write_text(TEXT)
    found = load_bvh(path, metres_per_unit=1.0)
    leg = [[2, 2, 3], [1, 1, 3]]  # down, turned a quarter about z, points along +x
    np.testing.assert_allclose(joint_positions(found)[:, 1], leg, atol=1e-12)
    assert found.parents.tolist() == [-1, 0]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("HIERARCHY", "ARMATURE"),
        ("MOTION", "MOTIO"),
        ("ROOT hips", "hips"),
        ("JOINT leg", "ROOT leg"),
        ("JOINT leg\n  {", "JOINT leg\n"),
        ("} } }", "} }"),
        ("} } }", "} } } }"),
        ("OFFSET 0 -1 0\n", "OFFSET 0 -1\n"),
        ("OFFSET 0 -1 0\n", "OFFSET nan 0 0\n"),
        ("CHANNELS 3", "CHANNELS 2"),
        ("CHANNELS 3", "CHANNELS -1"),
        ("CHANNELS 3", "CHANNELS 99999999"),
        ("Zrotation", "Wrotation"),
        ("End Site", "End Sight"),
        ("Frames: 2", "Frames: 3"),
        ("Frames: 2", "Frames: 999999999999"),
        ("Frames: 2", "Frames: -2"),
        ("Frame Time: 0.1", "Frame Time: 0"),
        ("Frame Time: 0.1", "Frame Time: nan"),
        ("90 0 0 0 0 0", "90 0 0 0 0"),
        ("90 0 0 0 0 0", "90 0 0 0 0 x"),
        ("90 0 0 0 0 0", "90 0 0 0 0 inf"),
    ],
)
def test_malformed_text_is_refused(old: str, new: str, tmp_path: Path) -> None:
    assert old in TEXT
    path = tmp_path / "a.bvh"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_bvh(path)
    assert "\n" not in str(caught.value)
    assert "a.bvh" in str(caught.value)


@pytest.mark.parametrize("time", ["0", "-0.1", "120"])
def test_times_of_frames_are_named(time: str, tmp_path: Path) -> None:
    """A rate in place of a time was refused as a rate of 0.00833, without the file's name."""
    path = tmp_path / "a.bvh"
    path.write_text(TEXT.replace("Frame Time: 0.1", f"Frame Time: {time}", 1))
    with pytest.raises(InputError, match=f"a.bvh: Frame Time is {time}; expected the seconds"):
        load_bvh(path)


def test_missing_and_binary_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "b.bvh").write_bytes(bytes(range(256)))
    for name in ("none.bvh", "b.bvh"):
        with pytest.raises(InputError, match=name):
            load_bvh(tmp_path / name)


def test_a_recorded_clip_stands_on_the_floor_and_survives_a_round_trip(tmp_path: Path) -> None:
    if not CLIPS.exists():
        pytest.skip("the CMU clips are not beside the checkout")
    clip = load_bvh(CLIPS / "02_01.bvh", metres_per_unit=0.056444)
    places = joint_positions(clip)[1:]  # frame 0 is an inserted T-pose
    assert len(clip.names) == 31
    assert clip.frame_time == pytest.approx(1 / 120, abs=1e-5)
    assert -0.05 < places[..., 1].min() < 0.1
    assert 1.3 < np.ptp(places[..., 1], axis=1).max() < 1.9
    save_bvh(tmp_path / "a.bvh", clip)
    back = load_bvh(tmp_path / "a.bvh")
    order = [back.names.index(name) for name in clip.names]
    np.testing.assert_allclose(joint_positions(back)[1:, order], places, atol=1e-5)


@pytest.mark.parametrize("unit", [0.0, -0.01, float("nan"), float("inf")])
def test_units_that_are_none_are_refused(unit: float, tmp_path: Path) -> None:
    save_bvh(tmp_path / "a.bvh", motion())
    with pytest.raises(InputError, match="metres_per_unit is"):
        load_bvh(tmp_path / "a.bvh", unit)
    with pytest.raises(InputError, match="metres_per_unit is"):
        save_bvh(tmp_path / "b.bvh", motion(), unit)


def test_files_of_other_editors_and_places(tmp_path: Path) -> None:
    given, path = motion(), tmp_path / "a.bvh"
    save_bvh(path, given)
    text = path.read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8-sig")
    np.testing.assert_allclose(load_bvh(path).rotations[0, 0], given.rotations[0, 0], atol=1e-7)
    path.write_text(text.replace(".", ","), encoding="utf-8")
    with pytest.raises(InputError, match="expected numbers with points, not commas"):
        load_bvh(path)


def test_turns_that_are_none_are_not_written(tmp_path: Path) -> None:
    good = motion()
    for wrong in (2 * good.rotations, -good.rotations):
        with pytest.raises(InputError, match="expected matrices of rotations"):
            save_bvh(tmp_path / "wrong.bvh", replace(good, rotations=wrong))
    assert not any(tmp_path.iterdir())
