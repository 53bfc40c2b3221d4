"""Left and right exchanged throughout, where two views see hips, neck and feet rarely at once."""

from dataclasses import replace

import torch
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import examine_agreement
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


def test_one_foot_and_the_middle_of_the_shoulders_are_enough() -> None:
    take = make_take(20)
    points = take.actor.joints(take.truth)
    for names in (("l_ankle",), ("r_toe",), ("neck",), ("neck", "l_toe")):
        some = points.clone()
        some[:, [LANDMARKS.index(name) for name in names]] = torch.nan
        assert not examine_sides("x", some)
        (found,) = examine_sides("x", some[:, MIRRORED])
        assert found.what == WORDS
