"""Left and right exchanged throughout, where two views see hips, neck and feet rarely at once."""

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import examine_agreement
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
