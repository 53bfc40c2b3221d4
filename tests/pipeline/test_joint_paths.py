"""Windows whose joints follow cosines with free coefficients: recovered motion, a swap undone."""

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.pipeline import capture
from perfcap.pipeline.presets import PRESETS

LEGS = [
    [LANDMARKS.index(f"{side}_{name}") for name in ("hip", "knee", "ankle", "toe")] for side in "lr"
]


def swapped(detections: Detections, view: int, frames: slice) -> Detections:
    pixels = detections.joints2d.clone()
    left, right = (detections.joints2d[frames, view][:, legs] for legs in LEGS)
    for legs, other in ((LEGS[0], right), (LEGS[1], left)):
        for joint, value in zip(legs, other.unbind(1), strict=True):
            pixels[frames, view, joint] = value
    return replace(detections, joints2d=pixels)


@pytest.mark.long
def test_the_published_two_stages_find_the_motion() -> None:
    take = make_take(45, views=3, lifted=False)
    found = capture(take.actor, take.cameras, take.detections, take.rate, PRESETS["muvs2017"])
    assert float(take.error_mm(found.joints()).mean()) < 6
    assert found.motion.shared == {}
    assert "paths" in found.report()["windows"][0]["terms"]


@pytest.mark.long
def test_legs_exchanged_in_one_view_are_undone() -> None:
    take = make_take(45, views=3, lifted=False)
    wrong = swapped(take.detections, 1, slice(20, 23))
    assert not torch.equal(wrong.joints2d, take.detections.joints2d)
    parts = take.actor, take.cameras, wrong, take.rate
    found = capture(*parts, PRESETS["muvs2017"])
    assert float(take.error_mm(found.joints())[18:25].max()) < 15
