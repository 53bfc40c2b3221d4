"""Left and right exchanged throughout: of views that see badly, of short clips, of raised legs."""

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.detect.lifter import OnnxLifter
from perfcap.io import models_folder, read_cameras, read_detections
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_agreement
from perfcap.io.doctor.detections import examine_detections
from perfcap.io.doctor.sides import examine_sides

MIRRORED = list(LANDMARKS16.mirrored())
WORDS = "left and right look exchanged: the feet point backwards"


def blinking(share: float) -> tuple[CameraRig, Detections]:
    """Two views of 60 frames, in each of which so many joints are not seen."""
    take = make_take(60, views=2, lifted=False)
    random = torch.Generator().manual_seed(3)
    seen = take.detections.confidence2d
    lost = torch.rand(seen.shape, generator=random) < share
    detections = replace(take.detections, confidence2d=torch.where(lost, 0, seen))
    return CameraRig(("left", "right"), take.cameras), detections


def test_exchanged_in_both_of_two_views_that_see_badly() -> None:
    rig, right = blinking(0.2)
    wrong = replace(
        right,
        joints2d=right.joints2d[:, :, MIRRORED],
        confidence2d=right.confidence2d[:, :, MIRRORED],
    )
    assert WORDS in [each.what for each in examine_agreement(rig, wrong)]
    assert not examine_agreement(rig, right)


@pytest.mark.parametrize("limb", [("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle", "toe")])
def test_arms_or_legs_of_one_view(limb: tuple[str, ...]) -> None:
    take = make_take(40, lifted=False, turns=0.1)
    rig, order = CameraRig(("view",), take.cameras), list(range(len(LANDMARKS)))
    for name in limb:
        left, right = (LANDMARKS.index(f"{side}_{name}") for side in "lr")
        order[left], order[right] = right, left
    wrong = replace(
        take.detections,
        joints2d=take.detections.joints2d[:, :, order],
        confidence2d=take.detections.confidence2d[:, :, order],
    )
    words = "hips and shoulders have left and right opposite ways"
    told = [
        " ".join(f.what for f in examine_detections(rig, seen)) for seen in (take.detections, wrong)
    ]
    assert words not in told[0] and words in told[1]


def test_one_foot_and_the_middle_of_the_shoulders_are_enough() -> None:
    take = make_take(20)
    points = take.actor.joints(take.truth)
    for names in (("l_ankle",), ("r_toe",), ("neck",), ("neck", "l_toe")):
        some = points.clone()
        some[:, [LANDMARKS.index(name) for name in names]] = torch.nan
        assert not examine_sides("x", some)
        (found,) = examine_sides("x", some[:, MIRRORED])
        assert found.what == WORDS


@pytest.mark.parametrize("frames", [1, 2, 4])
@pytest.mark.parametrize(
    ("limbs", "words"),
    [
        (("shoulder", "elbow", "wrist"), "left and right of the arms look exchanged"),
        (("hip", "knee", "ankle", "toe"), "left and right of the legs look exchanged"),
        (("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe"), WORDS),
    ],
)
def test_single_frames_say_so_where_it_is_plain(
    frames: int, limbs: tuple[str, ...], words: str
) -> None:
    take = make_take(20)
    joints = take.actor.joints(take.truth)[7 : 7 + frames]
    assert not examine_sides("x", joints)
    order = list(range(len(LANDMARKS)))
    for name in limbs:
        left, right = (LANDMARKS.index(f"{side}_{name}") for side in "lr")
        order[left], order[right] = right, left
    (found,) = examine_sides("x", joints[:, order])
    assert found.what.startswith(words) and found.severity is Severity.WARNING
    assert not examine_sides("x", without_feet(joints, guessed=False)[:, MIRRORED])


@pytest.mark.parametrize("first", [72, 74, 75])
def test_a_raised_leg_that_is_lifted_exchanges_nothing(first: int) -> None:
    """Of these frames of the shipped clip its own lifter has the trunk face away from the feet."""
    demo = models_folder() / "demo"
    rig = read_cameras(demo / "camera.json")
    given, _ = read_detections([demo / "detections.npz"], views=rig.names)
    part = given.frames(slice(first, first + 12))
    flat = replace(part, joints3d=None, trusted3d=torch.zeros_like(part.trusted3d))
    lifted = OnnxLifter(models_folder() / "lifters" / "cmu")(flat, rig.cameras, 30.0)
    told = examine_detections(rig, lifted, coverage=False)
    assert not [each for each in told if "left and right" in each.what]


def without_feet(points: torch.Tensor, guessed: bool) -> torch.Tensor:
    """Joints of a set that has no toes: unknown, or guessed to be at the ankles."""
    found = points.clone()
    for side in "lr":
        ankle = found[:, LANDMARKS.index(f"{side}_ankle")]
        found[:, LANDMARKS.index(f"{side}_toe")] = ankle if guessed else torch.nan
    return found


@pytest.mark.parametrize("guessed", [False, True])
def test_knees_tell_sides_of_joints_without_feet(guessed: bool) -> None:
    take = make_take(40)
    points = without_feet(bent(take.actor.joints(take.truth)), guessed)
    assert not examine_sides("s", points)
    nothing = without_feet(straight(take.actor.joints(take.truth)), guessed)
    words = "left and right look exchanged: the knees bend backwards"
    for wrong in (points[:, MIRRORED], points * torch.tensor([1.0, 1.0, -1.0])):
        assert [each.what for each in examine_sides("s", wrong)] == [words]
    assert not examine_sides("s", nothing[:, MIRRORED]), "straight knees say nothing"


def bent(points: torch.Tensor) -> torch.Tensor:
    """The same with feet behind, as of who runs on the spot."""
    return _legs(points, 0.6)


def straight(points: torch.Tensor) -> torch.Tensor:
    return _legs(points, 0.0)


def _legs(points: torch.Tensor, bend: float) -> torch.Tensor:
    at = dict(zip(LANDMARKS, points.unbind(1), strict=True))
    hips = at["l_hip"] - at["r_hip"]
    up = at["neck"] - 0.5 * (at["l_hip"] + at["r_hip"])
    ahead = torch.nn.functional.normalize(torch.linalg.cross(hips, up), dim=-1)
    down = -torch.nn.functional.normalize(up, dim=-1)
    found = points.clone()
    for side in "lr":
        knee = at[f"{side}_hip"] + 0.4 * down
        found[:, LANDMARKS.index(f"{side}_knee")] = knee
        found[:, LANDMARKS.index(f"{side}_ankle")] = knee + 0.4 * (down - bend * ahead)
    return found
