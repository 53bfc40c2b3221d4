"""Joints of a limb in each other's place in every frame and view, as in a hand-made order."""

from dataclasses import replace

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, examine_agreement, examine_detections
from perfcap.io.doctor.neighbours import examine_neighbours

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
