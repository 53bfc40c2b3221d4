"""The human skeleton: what each angle does, and rest poses of all kinds."""

import math

import pytest
import torch
from synthetic import mirror, random_motion, rest_positions
from torch import Tensor

from perfcap.actor.anatomy import JOINTS, human_rig
from perfcap.actor.motion import Motion
from perfcap.actor.skeleton import Pose, Skeleton
from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError

F64 = torch.float64
LEFT, UP, AHEAD = torch.eye(3, dtype=F64)
POSES = [
    pytest.param({}, id="A-pose"),
    pytest.param({"arms": 90.0, "elbows": 0.0, "knees": 0.0}, id="T-pose, straight"),
    pytest.param({"arms": 90.0}, id="T-pose"),
    pytest.param({"arms": 0.0}, id="hanging"),
    pytest.param({"arms": 0.0, "elbows": 0.0, "knees": 0.0}, id="hanging, straight"),
    pytest.param({"arms": 35.0, "elbows": 0.0}, id="straight arms"),
    pytest.param({"arms": 45.0, "elbows": -3.0, "knees": -3.0}, id="hyperextended"),
]


def posed(skeleton: Skeleton, **angles: float) -> Pose:
    """One frame: the neutral pose with some angles set."""
    values = torch.zeros(1, 27, dtype=F64)
    for name, value in angles.items():
        values[0, skeleton.angle_names.index(name)] = value
    zero = torch.zeros(1, 3, dtype=F64)
    pose: Pose = skeleton(Motion(zero, zero, values))
    return pose


def mark(pose: Pose, name: str) -> Tensor:
    return pose.landmarks[0, LANDMARKS.index(name)]


def turned(pose: Pose, joint: str) -> Tensor:
    return pose.rotation[0, JOINTS.index(joint)]


def towards(name: str) -> Tensor:
    """Outwards for the side of a name."""
    return LEFT if name.startswith("l_") else -LEFT


@pytest.fixture(scope="module")
def skeleton() -> Skeleton:
    return Skeleton(human_rig(rest_positions()))


@pytest.mark.parametrize("kind", POSES)
def test_any_rest_pose_gives_a_valid_rig(kind: dict[str, float]) -> None:
    skeleton = Skeleton(human_rig(rest_positions(**kind)))
    pose = skeleton(skeleton.rest_motion())
    assert torch.allclose(pose.position[0], skeleton.rig.positions, atol=1e-14)
    assert (skeleton.lower <= skeleton.rest_angles).all()
    assert (skeleton.rest_angles <= skeleton.upper).all()
    assert (skeleton.lower < skeleton.upper).all()
    axes = torch.tensor([hinge.axis for hinge in skeleton.rig.hinges], dtype=F64)
    assert torch.allclose(axes.norm(dim=-1), torch.ones(27, dtype=F64), atol=1e-12)


@pytest.mark.parametrize("aside", [-0.03, 0.0, 0.03])
def test_hinges_do_not_follow_a_slight_bend_to_the_side(aside: float) -> None:
    """Forearms that droop in a T-pose, and knees in or out of the leg's line, by a few degrees."""
    plain = rest_positions(arms=90.0, elbows=5.0, knees=7.0)
    at = dict(plain)
    for side, out in (("l", LEFT), ("r", -LEFT)):
        at[f"{side}_wrist"] = plain[f"{side}_wrist"] + aside * UP
        at[f"{side}_knee"] = plain[f"{side}_knee"] + aside * out
    straight, skewed = (
        {each.name: torch.tensor(each.axis, dtype=F64) for each in human_rig(pose).hinges}
        for pose in (plain, at)
    )
    for name in ("l_elbow_flexion", "r_elbow_flexion", "l_knee_flexion", "r_knee_flexion"):
        angle = math.degrees(math.acos(min(1.0, float(straight[name] @ skewed[name]))))
        assert angle < 10.0, name
    skeleton = Skeleton(human_rig(at))
    pose = skeleton(skeleton.rest_motion())
    assert torch.allclose(pose.position[0], skeleton.rig.positions, atol=1e-14)


@pytest.mark.parametrize("kind", POSES)
def test_arms_hang_and_legs_stand_in_the_neutral_pose(kind: dict[str, float]) -> None:
    neutral = posed(Skeleton(human_rig(rest_positions(**kind))))
    for side in "lr":
        for top, end in (
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
            ("hip", "knee"),
            ("knee", "ankle"),
        ):
            bone = mark(neutral, f"{side}_{end}") - mark(neutral, f"{side}_{top}")
            assert torch.allclose(bone / bone.norm(), -UP, atol=1e-9), f"{side}_{top}"


@pytest.mark.parametrize("kind", POSES)
def test_rest_angles_tell_the_rest_pose(kind: dict[str, float]) -> None:
    """Elbow and knee angles are what they were built with; arms are lifted by as much."""
    skeleton = Skeleton(human_rig(rest_positions(**kind)))
    rest = dict(zip(skeleton.angle_names, skeleton.rest_angles.rad2deg().tolist(), strict=True))
    wanted = {"arms": 45.0, "elbows": 12.0, "knees": 6.0} | kind
    for side in "lr":
        assert rest[f"{side}_elbow_flexion"] == pytest.approx(wanted["elbows"], abs=1e-6)
        assert rest[f"{side}_knee_flexion"] == pytest.approx(wanted["knees"], abs=1e-6)
        assert abs(rest[f"{side}_hip_abduction"]) < 1e-6
        assert rest[f"{side}_hip_flexion"] == pytest.approx(wanted["knees"] / 2, abs=1e-6)


CENTRE = [
    ("spine_flexion", "neck", UP, AHEAD),
    ("spine_lateral", "neck", UP, LEFT),
    ("spine_axial", "spine", AHEAD, LEFT),
    ("neck_flexion", "neck", UP, AHEAD),
    ("neck_lateral", "neck", UP, LEFT),
    ("neck_axial", "neck", AHEAD, LEFT),
    ("head_nod", "head", UP, AHEAD),
]


@pytest.mark.parametrize(("angle", "joint", "vector", "goes"), CENTRE)
def test_positive_centre_angles(
    skeleton: Skeleton, angle: str, joint: str, vector: Tensor, goes: Tensor
) -> None:
    """Bending forwards, leaning left, turning left: a vector of the joint goes that way."""
    change = turned(posed(skeleton, **{angle: 0.3}), joint) @ vector
    assert torch.allclose(change, math.cos(0.3) * vector + math.sin(0.3) * goes, atol=1e-9)


@pytest.mark.parametrize("side", ["l", "r"])
class TestSides:
    """What positive means, on both sides of the body."""

    def moved(self, skeleton: Skeleton, name: str, angle: str, **before: float) -> Tensor:
        """Displacement of a landmark when an angle grows from 0 (or from before) by 0.3."""
        start = before.get(angle, 0.0)
        return mark(posed(skeleton, **(before | {angle: start + 0.3})), name) - mark(
            posed(skeleton, **before), name
        )

    def test_shoulder_elevation_lifts_in_front_of_the_frontal_plane(
        self, skeleton: Skeleton, side: str
    ) -> None:
        move = self.moved(skeleton, f"{side}_elbow", f"{side}_shoulder_elevation")
        assert move @ UP > 0
        assert move @ towards(side + "_") > move @ AHEAD > 0

    def test_shoulder_horizontal_brings_a_lifted_arm_forwards(
        self, skeleton: Skeleton, side: str
    ) -> None:
        before = {f"{side}_shoulder_elevation": math.pi / 2}
        move = self.moved(skeleton, f"{side}_elbow", f"{side}_shoulder_horizontal", **before)
        assert move @ AHEAD > 0
        assert move @ towards(side + "_") < 0
        assert abs(move @ UP) < 1e-9

    def test_shoulder_rotation_is_inwards(self, skeleton: Skeleton, side: str) -> None:
        before = {f"{side}_elbow_flexion": math.pi / 2}
        move = self.moved(skeleton, f"{side}_wrist", f"{side}_shoulder_rotation", **before)
        assert move @ towards(side + "_") < -0.05

    def test_elbow_flexion_brings_the_wrist_forwards_and_up(
        self, skeleton: Skeleton, side: str
    ) -> None:
        move = self.moved(skeleton, f"{side}_wrist", f"{side}_elbow_flexion")
        assert move @ AHEAD > 0.05
        assert move @ UP > 0
        assert abs(move @ LEFT) < 1e-9

    def test_hip_flexion_brings_the_knee_forwards(self, skeleton: Skeleton, side: str) -> None:
        move = self.moved(skeleton, f"{side}_knee", f"{side}_hip_flexion")
        assert move @ AHEAD > 0.1
        assert abs(move @ LEFT) < 1e-9

    def test_hip_abduction_brings_the_knee_outwards(self, skeleton: Skeleton, side: str) -> None:
        move = self.moved(skeleton, f"{side}_knee", f"{side}_hip_abduction")
        assert move @ towards(side + "_") > 0.1
        assert abs(move @ AHEAD) < 1e-9

    def test_hip_rotation_is_inwards(self, skeleton: Skeleton, side: str) -> None:
        toe = self.moved(skeleton, f"{side}_toe", f"{side}_hip_rotation")
        assert toe @ towards(side + "_") < -0.01
        before = {f"{side}_knee_flexion": math.pi / 2}
        ankle = self.moved(skeleton, f"{side}_ankle", f"{side}_hip_rotation", **before)
        assert ankle @ towards(side + "_") > 0.05  # a bent shank swings out instead

    def test_knee_flexion_brings_the_ankle_back(self, skeleton: Skeleton, side: str) -> None:
        move = self.moved(skeleton, f"{side}_ankle", f"{side}_knee_flexion")
        assert move @ AHEAD < -0.1
        assert abs(move @ LEFT) < 1e-9

    def test_dorsiflexion_lifts_the_toe(self, skeleton: Skeleton, side: str) -> None:
        move = self.moved(skeleton, f"{side}_toe", f"{side}_ankle_dorsiflexion")
        assert move @ UP > 0.03

    def test_inversion_turns_the_sole_inwards(self, skeleton: Skeleton, side: str) -> None:
        before = turned(posed(skeleton), f"{side}_ankle") @ -UP
        after = turned(posed(skeleton, **{f"{side}_ankle_inversion": 0.3}), f"{side}_ankle") @ -UP
        assert (after - before) @ towards(side + "_") < -0.1


def test_every_angle_has_its_sign_tested(skeleton: Skeleton) -> None:
    assert len(skeleton.angle_names) == 27
    tested = {angle for angle, *_ in CENTRE}
    kinds = {name[2:] for name in skeleton.angle_names if name[:2] in ("l_", "r_")}
    assert tested == {name for name in skeleton.angle_names if name[:2] not in ("l_", "r_")}
    assert len(kinds) == sum(name.startswith("test_") for name in vars(TestSides))


def test_mirrored_angles_give_mirrored_people(skeleton: Skeleton) -> None:
    motion = random_motion(skeleton, 20)
    pose = skeleton(motion)
    across = skeleton(
        Motion(mirror(motion.translation), -mirror(motion.rotation), _swap(skeleton, motion.angles))
    )
    swapped = [LANDMARKS.index(_other(name)) for name in LANDMARKS]
    assert torch.allclose(across.landmarks[:, swapped], mirror(pose.landmarks), atol=1e-12)
    assert torch.allclose(skeleton.lower, _swap(skeleton, skeleton.lower, flip=False))
    assert torch.allclose(skeleton.rest_angles, _swap(skeleton, skeleton.rest_angles))


def _other(name: str) -> str:
    return {"l_": "r_", "r_": "l_"}.get(name[:2], name[:2]) + name[2:]


def _swap(skeleton: Skeleton, angles: Tensor, flip: bool = True) -> Tensor:
    """Left and right angles exchanged; leaning and turning to the other side."""
    names = skeleton.angle_names
    order = [names.index(_other(name)) for name in names]
    to_a_side = [name in _TO_A_SIDE and flip for name in names]
    return angles[..., order] * torch.where(torch.tensor(to_a_side), -1.0, 1.0).double()


_TO_A_SIDE = ("spine_lateral", "spine_axial", "neck_lateral", "neck_axial")


def test_rest_poses_of_one_person_agree_in_the_neutral_pose() -> None:
    """A T-pose and an A-pose of the same body are the same skeleton."""
    first = posed(Skeleton(human_rig(rest_positions(arms=45.0))))
    other = posed(Skeleton(human_rig(rest_positions(arms=90.0))))
    assert torch.allclose(first.landmarks, other.landmarks, atol=1e-9)


def test_missing_bones_are_named() -> None:
    positions = rest_positions()
    del positions["l_knee"], positions["head_top"]
    with pytest.raises(InputError, match="no bone named l_knee, head_top"):
        human_rig(positions)


def test_a_toe_at_the_ankle_is_refused_by_its_name() -> None:
    places = dict(rest_positions())
    places["r_toe"] = places["r_ankle"] - torch.tensor([0.0, 0.05, 0.0], dtype=F64)
    with pytest.raises(
        InputError, match="r_toe lies at or straight below r_ankle; expected the toes"
    ):
        human_rig(places)


def test_a_body_on_a_line_is_refused() -> None:
    line = {name: torch.tensor([0.0, 1.0, 0.0]) * i for i, name in enumerate(rest_positions())}
    with pytest.raises(InputError, match="on one line"):
        human_rig(line)
