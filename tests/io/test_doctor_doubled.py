"""Joints that are copies of others, as where one index was written for another."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.doctor.doubled import examine_doubled
from perfcap.io.doctor.given import examine_given
from perfcap.pipeline.pose_refiner import PoseRefiner

TAKE = make_take(40)
ANKLE, TOE = LANDMARKS.index("l_ankle"), LANDMARKS.index("l_toe")
NECK, CROWN = LANDMARKS.index("neck"), LANDMARKS.index("head_top")
EVERY = torch.ones(40, 16, dtype=torch.bool)


def told(first: int, second: int, part: str, frames: int = 40) -> str:
    """What is said where some frames have one joint in the column of another."""
    joints = getattr(TAKE.detections, part).clone()
    joints[:frames, :, second] = joints[:frames, :, first]
    seen = replace(TAKE.detections, **{part: joints})
    return " ".join(str(each) for each in examine_given(TAKE.cameras, seen))


@pytest.mark.parametrize(
    ("first", "second", "names", "part"),
    [
        (ANKLE, TOE, "l_ankle and l_toe", "joints2d"),
        (NECK, CROWN, "head_top and neck", "joints2d"),
        (NECK, CROWN, "head_top and neck", "joints3d"),
    ],
)
def test_a_copy_is_named(first: int, second: int, names: str, part: str) -> None:
    """The neck in the place of a crown was taken for one."""
    assert f"{names} lie at one place, to the last digit, in every frame" in told(
        first, second, part
    )


def test_several_pairs_are_one_finding() -> None:
    joints = TAKE.detections.joints2d[:, 0].clone()
    joints[:, [TOE, CROWN]] = joints[:, [ANKLE, NECK]]
    (found,) = examine_doubled("view", joints, EVERY)
    assert "head_top and neck, l_ankle and l_toe lie" in found.what


def test_what_was_not_found_and_a_few_frames_are_no_copies() -> None:
    assert "one place" not in told(ANKLE, TOE, "joints2d", 15)
    assert "one place" not in told(ANKLE, TOE, "joints3d")  # guessed, of joints without toes
    unseen = EVERY.clone()
    unseen[:, TOE] = False
    joints = TAKE.detections.joints2d[:, 0].clone()
    joints[:, TOE] = joints[:, ANKLE]
    assert not examine_doubled("view", joints, unseen)
    assert not examine_doubled("view", TAKE.detections.joints2d[:, 0].round(), EVERY)


def test_a_refiner_names_it() -> None:
    seen = TAKE.detections
    joints = seen.joints2d.clone()
    joints[:, :, CROWN] = joints[:, :, NECK]
    refiner = PoseRefiner(TAKE.actor, rate=TAKE.rate)
    with pytest.warns(UserWarning, match="head_top and neck lie at one place"):
        refiner(TAKE.cameras, joints, seen.confidence2d, seen.joints3d)
