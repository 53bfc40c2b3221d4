"""Motion of one skeleton on another."""

import math
import warnings
from dataclasses import replace

import pytest
import torch
from synthetic import actor, rest_positions, template
from takes import sway

from perfcap.actor.actor import Actor
from perfcap.actor.anatomy import JOINTS
from perfcap.actor.motion import Motion
from perfcap.actor.sole_points import sole_skeleton
from perfcap.errors import InputError
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.pipeline.config import RetargetConfig
from perfcap.pipeline.joint_motion import JointMotion, carried_landmarks, leg_length, wanted_turns
from perfcap.pipeline.motion_order import order_doubts
from perfcap.pipeline.retarget_rows import Rows
from perfcap.pipeline.retarget_scores import retarget_scores
from perfcap.pipeline.retargeting import Retargeted, retarget

F64 = torch.float64
PERSON = actor()
FREE = RetargetConfig()
FREE = replace(FREE, contact=replace(FREE.contact, enabled=False))


def t_pose() -> Actor:
    """The same person, drawn with other arms and knees."""
    return Actor(template(rest_positions(arms=85, elbows=20, knees=12)))


def built(**factors: float) -> Actor:
    """The person with other lengths of bones, in log factors of their groups."""
    groups = PERSON.skeleton.group_names
    return PERSON.resized(torch.tensor([factors.get(name, 0.0) for name in groups], dtype=F64))


def joints_of(person: Actor, motion: Motion) -> JointMotion:
    pose = person.skeleton(motion)
    return JointMotion(pose.rotation, pose.position)


def walk(person: Actor, frames: int = 60) -> Motion:
    """Steps on the spot and ahead: the feet take turns at standing still, knees bend."""
    motion = sway(person, frames)
    names = person.skeleton.angle_names
    time = torch.arange(frames, dtype=F64) / 30
    angles = torch.zeros_like(motion.angles) + 0.05
    for side, phase in (("l", 0.0), ("r", torch.pi)):
        lift = (torch.sin(2 * torch.pi * 0.8 * time + phase)).clamp(min=0)
        angles[:, names.index(f"{side}_hip_flexion")] = 0.7 * lift
        angles[:, names.index(f"{side}_knee_flexion")] = 1.4 * lift
        angles[:, names.index(f"{side}_ankle_dorsiflexion")] = -0.3 * lift
        angles[:, names.index(f"{side}_shoulder_elevation")] = 0.3 + 0.4 * lift
        angles[:, names.index(f"{side}_elbow_flexion")] = 0.5 + lift
    flat = replace(motion, translation=0 * motion.translation, angles=angles)
    flat = replace(flat, rotation=0 * flat.rotation)
    soles = sole_skeleton(person)(flat).landmarks[:, -8:]
    lowest = soles[..., 1].amin(1)
    place = torch.stack((0 * lowest, -lowest, 0 * lowest), -1)
    return replace(flat, translation=place)


def test_a_person_on_themselves() -> None:
    motion = sway(PERSON, 40, turns=0.7)
    found = retarget(PERSON, joints_of(PERSON, motion), PERSON, 30.0, FREE)
    assert found.scale == pytest.approx(1)
    ankles = [k for k, name in enumerate(PERSON.skeleton.angle_names) if "ankle" in name]
    assert (PERSON.joints(found.motion) - PERSON.joints(motion)).norm(dim=-1).max() < 1e-4
    assert (found.motion.angles - motion.angles)[:, ankles].abs().max() < 1e-3


def test_another_rest_pose_is_no_other_motion() -> None:
    """Arms of a T-pose and bent knees: the pose in the world stays, to what limits leave."""
    other = t_pose()
    motion = sway(PERSON, 30)
    found = retarget(PERSON, joints_of(PERSON, motion), other, 30.0, FREE)
    scores = retarget_scores(PERSON, joints_of(PERSON, motion), other, found, 30.0)
    assert scores.limbs.max() < 0.5
    assert scores.reach.max() < 3
    assert (other.joints(found.motion) - PERSON.joints(motion)).norm(dim=-1).max() < 0.02


@pytest.mark.parametrize("far", [1.0, 50.0])  # by metres, and where a world's origin is far away
def test_turned_and_moved_sources_give_turned_and_moved_results(far: float) -> None:
    other, motion = built(thigh=0.1, upper_arm=-0.1), sway(PERSON, 20)
    joints = joints_of(PERSON, motion)
    turn = rotvec_to_matrix(torch.tensor([0.0, 2.0, 0.0], dtype=F64))
    away = far * torch.tensor([3.0, 0.0, -2.0], dtype=F64)
    elsewhere = JointMotion(turn @ joints.rotation, joints.position @ turn.mT + away)
    one = retarget(PERSON, joints, other, 30.0, FREE)
    two = retarget(PERSON, elsewhere, other, 30.0, FREE)
    expected = other.joints(one.motion) @ turn.mT + one.scale * away
    assert torch.allclose(other.joints(two.motion), expected, atol=1e-5)


BUILDS = ({"thigh": 0.15, "shank": 0.1, "upper_arm": 0.1, "forearm": 0.1}, {"hips": 0.2},
          {"thigh": -0.15, "shank": -0.12, "foot": -0.1})  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("build", BUILDS)
def test_other_builds_keep_directions_reach_and_feet(build: dict[str, float]) -> None:
    other, motion = built(**build), walk(PERSON)
    joints = joints_of(PERSON, motion)
    found = retarget(PERSON, joints, other, 30.0)
    scores = retarget_scores(PERSON, joints, other, found, 30.0)
    assert scores.limbs.mean() < 3
    assert scores.reach.mean() < 20
    assert scores.slide < 1  # mm in a frame; of feet that stand still in the source
    assert found.scale == pytest.approx(leg_length(other) / leg_length(PERSON))
    skeleton = other.skeleton
    assert (found.motion.angles >= skeleton.lower - 1e-9).all()
    assert (found.motion.angles <= skeleton.upper + 1e-9).all()
    soles = sole_skeleton(other)(found.motion).landmarks[:, -8:, 1]
    assert found.floor is not None and float(found.floor.height) == 0
    assert soles.min() > -0.015
    assert soles.amin(1).abs().median() < 0.005


@pytest.mark.long
def test_corrections_are_slow() -> None:
    """Where feet land and leave, the motion does not pop: accelerations stay those of a person."""
    other, motion = built(thigh=0.15, hips=0.2), walk(PERSON)
    joints = joints_of(PERSON, motion)
    loose = retarget(PERSON, joints, other, 30.0, FREE)
    tied = retarget(PERSON, joints, other, 30.0)

    def jolts(found: Retargeted) -> torch.Tensor:
        return (900 * other.joints(found.motion).diff(n=2, dim=0)).norm(dim=-1)

    assert jolts(tied).quantile(0.99) < 1.5 * jolts(loose).quantile(0.99)


def test_wanted_turns_point_limbs_where_the_source_does() -> None:
    other, motion = t_pose(), sway(PERSON, 5)
    joints = joints_of(PERSON, motion)
    wanted = wanted_turns(PERSON, joints, other.skeleton)
    names = PERSON.skeleton.rig.joints
    for start, end in (("l_shoulder", "l_elbow"), ("r_knee", "r_ankle")):
        a, b = names.index(start), names.index(end)
        rest = other.skeleton.rest_positions
        along = (wanted[:, a] @ (rest[b] - rest[a])) / (rest[b] - rest[a]).norm()
        theirs = joints.position[:, b] - joints.position[:, a]
        assert torch.allclose(along, theirs / theirs.norm(dim=-1, keepdim=True), atol=1e-9)


def test_landmarks_on_joints() -> None:
    motion = sway(PERSON, 4)
    found = carried_landmarks(PERSON.skeleton, joints_of(PERSON, motion))
    assert torch.allclose(found, PERSON.joints(motion), atol=1e-12)


def test_one_frame() -> None:
    motion = sway(PERSON, 1)
    found = retarget(PERSON, joints_of(PERSON, motion), t_pose(), 30.0)
    assert found.motion.frames == 1 and found.motion.angles.isfinite().all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"frames": 0}, "frames of RetargetConfig is 0"),
        ({"change": (0.0, 0.5, 1.0)}, "change is"),
        ({"turns": {"l_kne": 3.0}}, "turns are of l_kne"),
        ({"speed": -1.0}, "speed of RetargetConfig is -1"),
    ],
)
def test_settings_that_are_none_are_refused(changes: dict, words: str) -> None:
    joints = joints_of(PERSON, walk(PERSON, 4))
    with pytest.raises(InputError, match=words):
        retarget(PERSON, joints, PERSON, 30.0, replace(FREE, **changes))


def test_joints_of_other_shapes_and_units_are_refused() -> None:
    joints = joints_of(PERSON, walk(PERSON, 4))
    rotation, position = joints.rotation, joints.position
    with pytest.raises(InputError, match="rotation has shape"):
        JointMotion(rotation, position[:2])
    with pytest.raises(InputError, match="no number"):
        JointMotion(rotation, position * torch.nan)
    with pytest.raises(InputError, match="limbs are 1e\\+03 times as long"):
        retarget(PERSON, JointMotion(rotation, 1000 * position), PERSON, 30.0, FREE)
    turned = rotvec_to_matrix(torch.tensor([0.0, 0.0, 1.2], dtype=F64)) @ rotation
    with pytest.warns(UserWarning, match="rotations take the source's limbs"):
        retarget(PERSON, JointMotion(turned, position), PERSON, 30.0, FREE, examined=True)


def test_hands_are_kept_together_the_more_the_nearer_they_are() -> None:
    """Full weight where they touch, a quarter at the stated distance, next to none far apart."""
    motion = sway(PERSON, 5)
    joints = joints_of(PERSON, motion)
    left, right = JOINTS.index("l_wrist"), JOINTS.index("r_wrist")
    apart = torch.tensor([0.0, 1.0, 3.0, 6.0, 10.0], dtype=F64) * FREE.near
    position = joints.position.clone()
    position[:, left] = position[:, right]
    position[:, left, 0] += apart
    rows = Rows.of(PERSON, JointMotion(joints.rotation, position), PERSON, motion, FREE)
    (row,) = [k for k in range(rows.sure.shape[1]) if rows.sure[:, k].min() < 1]
    sure = rows.sure[:, row]
    assert sure[0] == 1 and sure[1] == pytest.approx(0.25)
    assert (sure.diff() < 0).all() and sure[-1] < 1e-3


def test_turns_sizes_and_worlds_of_something_else() -> None:
    """All of them gave a motion, with nothing said."""
    joints = joints_of(PERSON, walk(PERSON, 6))
    for wrong in (2 * joints.rotation, -joints.rotation):
        with pytest.raises(InputError, match="rotation holds matrices that are none"):
            JointMotion(wrong, joints.position)
    with pytest.warns(UserWarning, match="limbs are 2 times as long as the source's"):
        larger = replace(joints, position=2 * joints.position)
        retarget(PERSON, larger, PERSON, 30.0, FREE, examined=True)
    turn = rotvec_to_matrix(torch.tensor([torch.pi / 2, 0.0, 0.0], dtype=F64))
    z_up = JointMotion(turn @ joints.rotation, joints.position @ turn.mT)
    with pytest.warns(UserWarning, match="the person lies in nearly all frames"):
        retarget(PERSON, z_up, PERSON, 30.0, FREE, examined=True)
    with pytest.raises(InputError, match="joints is a Actor, expected a JointMotion"):
        retarget(PERSON, PERSON, joints, 30.0, FREE)  # type: ignore[arg-type]


def test_seconds_of_a_frame_are_no_rate() -> None:
    joints = joints_of(PERSON, walk(PERSON, 6))
    with pytest.warns(UserWarning, match=r"retarget: rate is 0\.03333 frames a second"):
        retarget(PERSON, joints, PERSON, 1 / 30, FREE)


@pytest.mark.parametrize("mistake", ["none", "no order", "text", "backwards", "held"])
def test_frames_that_do_not_follow_one_another(mistake: str) -> None:
    """All of them gave a motion that shakes or leaps, with nothing said."""
    count = 60
    joints = joints_of(PERSON, walk(PERSON, count))
    ahead = torch.linspace(0, 3, count, dtype=F64)[:, None, None] * torch.eye(3, dtype=F64)[2]
    joints = replace(joints, position=joints.position + ahead)
    index, part = torch.arange(count), slice(14, 31)
    said = {
        "no order": (torch.randperm(count, generator=torch.Generator().manual_seed(0)), "follow"),
        "text": (torch.tensor(sorted(range(count), key=str)), "sorted as text"),
        "backwards": (torch.cat((index[:14], index[part].flip(0), index[31:])), "frames 14-30"),
        "held": (index.where((index < 14) | (index > 30), 14), "16 of 59 frames repeat the joints"),
    }
    order, words = said.get(mistake, (index, ""))
    moved = JointMotion(joints.rotation[order], joints.position[order])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        retarget(PERSON, moved, PERSON, 30.0, FREE, examined=True)
    lines = [str(each.message) for each in told]
    assert len(lines) == (mistake != "none") and all(words in line for line in lines), lines


@pytest.mark.parametrize(("place", "words"), [(0, "the first frame is"), (-1, "the last frame is")])
def test_a_rest_pose_before_or_after_the_motion(place: int, words: str) -> None:
    """Libraries begin their files with one: the character stood so, then leapt."""
    motion = walk(PERSON)
    elevation = [PERSON.skeleton.angle_names.index(f"{s}_shoulder_elevation") for s in "lr"]
    angles = motion.angles.clone()
    angles[place] = 0
    angles[place, elevation] = 1.5
    (line,) = order_doubts(joints_of(PERSON, replace(motion, angles=angles)).position, 30.0)
    assert words in line and "leave a rest pose out" in line
    assert not list(order_doubts(joints_of(PERSON, motion).position, 30.0))
    quick = joints_of(PERSON, motion).position[::6]  # five frames a second
    assert not list(order_doubts(quick, 5.0))


@pytest.mark.long
@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_a_world_that_leans_is_told(degrees: float) -> None:
    """As that of a camera that looks down, in which other programs give motion."""
    motion = walk(PERSON)
    ahead = torch.linspace(0, 0.8, 60, dtype=F64)[:, None] * torch.tensor([0.0, 0.0, 1.0])
    joints = joints_of(PERSON, replace(motion, translation=motion.translation + ahead))
    way = rotvec_to_matrix(torch.tensor([math.radians(degrees), 0.0, 0.0], dtype=F64))
    turned = JointMotion(way @ joints.rotation, joints.position @ way.mT)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        retarget(PERSON, turned, PERSON, 30.0)
    assert any("floor that leans by" in str(each.message) for each in told) == bool(degrees)


@pytest.mark.parametrize("examined", [False, True])
def test_what_came_of_it_is_looked_at(examined: bool) -> None:
    """As the command does: in Python leaps and limbs elsewhere were silent."""
    joints = joints_of(PERSON, walk(PERSON))
    leap = joints.position.clone()
    leap[30:, :, 0] += 2.0
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        retarget(PERSON, replace(joints, position=leap), PERSON, 30.0, examined=examined)
    assert any("faster than any runner" in str(each.message) for each in told) != examined
