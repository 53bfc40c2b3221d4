"""Joints of a limb in each other's place in every frame and view, as in a hand-made order."""

from dataclasses import replace

import pytest
import torch
from synthetic import actor as person
from synthetic import cameras as circle
from takes import detect, make_take, sway
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_agreement, examine_detections
from perfcap.io.doctor.evidence import Scene
from perfcap.io.doctor.neighbours import examine_crown, examine_neighbours

PAIRS = (
    ("l_elbow", "l_wrist"),
    ("r_knee", "r_ankle"),
    ("l_shoulder", "l_elbow"),
    ("r_hip", "r_knee"),
    ("l_shoulder", "l_wrist"),
    ("r_hip", "r_ankle"),
    ("head_top", "neck"),
)


def exchanged(joints: Tensor, pair: tuple[str, str], axis: int = -2) -> Tensor:
    order = list(range(len(LANDMARKS)))
    first, second = map(LANDMARKS.index, pair)
    order[first], order[second] = second, first
    return joints.index_select(axis, torch.tensor(order))


def spoiled(seen: Detections, pair: tuple[str, str]) -> Detections:
    poses = seen.joints3d
    return replace(
        seen,
        joints2d=exchanged(seen.joints2d, pair),
        confidence2d=exchanged(seen.confidence2d, pair, axis=-1),
        joints3d=None if poses is None else exchanged(poses, pair),
    )


@pytest.mark.parametrize("pair", PAIRS)
def test_joints_in_each_others_place_are_named(pair: tuple[str, str]) -> None:
    take = make_take(60, views=3)
    rig = CameraRig(("a", "b", "c"), take.cameras)
    flat = take.detections.without_poses()
    assert examine_agreement(rig, flat) == []
    one = make_take(60)
    alone = CameraRig(("a",), one.cameras)
    assert examine_detections(alone, one.detections) == []
    for found in (
        examine_agreement(rig, spoiled(flat, pair)),
        examine_detections(alone, spoiled(one.detections, pair)),
    ):
        (finding,) = [each for each in found if "as named" in each.what]
        assert finding.severity is Severity.WARNING
        assert finding.what.startswith(f"{pair[0]} and {pair[1]} look exchanged: as named, no ")


def test_both_sides_are_named_at_once() -> None:
    joints = make_take(20).actor.joints(make_take(20).truth)
    for pair in (("l_elbow", "l_wrist"), ("r_elbow", "r_wrist")):
        joints = exchanged(joints, pair)
    (found,) = examine_neighbours("a", joints)
    assert found.what.startswith("l_elbow and l_wrist, r_elbow and r_wrist look exchanged")


def test_bent_limbs_and_unknown_joints_say_nothing() -> None:
    """Folded arms and legs all the time, and joints that are known in a few frames."""
    joints = make_take(20).actor.joints(make_take(20).truth)
    folded = joints.clone()
    for side in "lr":
        for upper, middle, end in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")):
            at = [LANDMARKS.index(f"{side}_{name}") for name in (upper, middle, end)]
            folded[:, at[2]] = folded[:, at[0]] + 0.1 * (folded[:, at[2]] - folded[:, at[1]])
    few = exchanged(joints, ("l_elbow", "l_wrist"))
    few[9:] = torch.nan
    for case in (joints, folded, few):
        assert examine_neighbours("a", case) == []


@pytest.mark.parametrize("lifted", [False, True])
def test_neck_and_crown_of_one_view(lifted: bool) -> None:
    """Beside the 3D poses of a lifter too, which knows of no other order."""
    take = make_take(20)
    alone = CameraRig(("a",), take.cameras)
    seen = take.detections if lifted else take.detections.without_poses()
    assert examine_detections(alone, seen) == []
    joints = exchanged(seen.joints2d, ("head_top", "neck"))
    found = examine_detections(alone, replace(seen, joints2d=joints))
    assert any("head_top and neck look exchanged: the crown is nearer" in e.what for e in found)


def test_a_crown_above_the_shoulders_is_none() -> None:
    """As a camera at the ceiling sees it."""
    pixels = make_take(20).detections.joints2d[:, 0].clone()
    shoulders = [LANDMARKS.index(f"{side}_shoulder") for side in "lr"]
    middle = pixels[:, shoulders].mean(1)
    width = (pixels[:, shoulders[0]] - pixels[:, shoulders[1]]).norm(dim=-1, keepdim=True)
    for name, share in (("head_top", 0.05), ("neck", 0.3)):
        pixels[:, LANDMARKS.index(name)] = middle + share * width
    assert examine_crown("a", pixels, torch.ones(pixels.shape[:2])) == []


def test_bones_have_no_length_where_two_views_face_each_other() -> None:
    """Right joints, a few pixels off: crowns and elbows were called necks and wrists."""
    actor = person()
    cameras = circle(4, size=600).select([0, 2])
    moved = sway(actor, 24, 30.0)
    lower = replace(moved, translation=moved.translation - torch.tensor([0.0, 0.5, 0.0]))
    seen = detect(actor, cameras, lower, lifted=False)  # necks are between the cameras
    rig = CameraRig(("a", "b"), cameras)
    random = torch.Generator().manual_seed(0)
    for _ in range(6):
        noise = 6.0 * torch.randn(seen.joints2d.shape, generator=random)
        found = examine_agreement(rig, replace(seen, joints2d=seen.joints2d + noise))
        assert not any("as named" in each.what for each in found)


def test_rays_cross_where_views_see_the_person_from_two_sides() -> None:
    cameras = circle(4, size=600)
    seen = detect(person(), cameras, sway(person(), 3, 30.0), lifted=False)
    points = person().joints(sway(person(), 3, 30.0))
    every = Scene(cameras, seen)
    assert float(every.select([0, 1]).crossing(points).min()) > 0.8
    assert float(every.select([0, 2]).crossing(points).max()) < 0.5
    one = replace(seen, confidence2d=seen.confidence2d * torch.tensor([1, 0, 1, 0])[:, None])
    hidden = Scene(cameras, one).crossing(points)
    torch.testing.assert_close(hidden, every.select([0, 2]).crossing(points))


@pytest.mark.parametrize(("frames", "bent", "named"), [(12, True, False), (12, False, True)])
def test_short_forearms_of_few_frames_are_no_exchange(frames: int, bent: bool, named: bool) -> None:
    """Bent arms of skeletons whose forearms are short: right ones; straight ones exchanged."""
    points = person().joints(sway(person(), frames, 30.0)).clone()
    shoulder, elbow, wrist = (LANDMARKS.index(f"l_{n}") for n in ("shoulder", "elbow", "wrist"))
    noise = 0.01 * torch.randn(frames, 3, generator=torch.Generator().manual_seed(1)).double()
    start = points[:, shoulder]
    down, ahead = torch.tensor([0.0, -0.28, 0.0]), torch.tensor([0.0, 0.12, 0.12])
    points[:, elbow] = start + down + (noise if bent else 0)
    points[:, wrist] = start + down + (ahead if bent else 0.9 * down + noise)
    if not bent:
        points = exchanged(points, ("l_elbow", "l_wrist"))
    assert bool(examine_neighbours("detections", points)) is named
