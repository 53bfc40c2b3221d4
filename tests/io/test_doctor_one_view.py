"""Joints that are in each other's place in one of several views, of which medians show nothing."""

from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Severity, agreement, examine_agreement
from perfcap.io.doctor.evidence import Scene
from perfcap.io.doctor.hypotheses import Hypothesis

ARMS = tuple((f"l_{name}", f"r_{name}") for name in ("shoulder", "elbow", "wrist"))
MISTAKES = {
    "elbows and wrists": (("l_elbow", "l_wrist"), ("r_elbow", "r_wrist")),
    "knees and ankles": (("l_knee", "l_ankle"), ("r_knee", "r_ankle")),
    "l_wrist and r_wrist": (("l_wrist", "r_wrist"),),
    "left and right of the arms": ARMS,
}


def spoiled(seen: Detections, view: int, pairs: tuple[tuple[str, str], ...]) -> Detections:
    order = list(range(len(LANDMARKS)))
    for pair in pairs:
        one, other = map(LANDMARKS.index, pair)
        order[one], order[other] = other, one
    joints, confidence = seen.joints2d.clone(), seen.confidence2d.clone()
    joints[:, view], confidence[:, view] = joints[:, view][:, order], confidence[:, view][:, order]
    return replace(seen, joints2d=joints, confidence2d=confidence)


@pytest.mark.parametrize("views", [2, 3, 4])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_joints_exchanged_in_one_view_are_named(mistake: str, views: int) -> None:
    take = make_take(60, views=views)
    names = tuple("abcd"[:views])
    rig, seen = CameraRig(names, take.cameras), take.detections.without_poses()
    assert examine_agreement(rig, seen) == []
    (found,) = examine_agreement(rig, spoiled(seen, 1, MISTAKES[mistake]))
    assert found.severity is Severity.WARNING and found.what.startswith(f"{mistake} look exchanged")
    assert found.subject == ("b" if views > 2 else "a or b")


def test_joints_that_are_far_off_are_not_exchanged() -> None:
    take = make_take(60, views=3)
    rig, seen = CameraRig(("a", "b", "c"), take.cameras), take.detections.without_poses()
    wrists = torch.tensor([name.endswith("wrist") for name in LANDMARKS])
    off = seen.joints2d + 40 * wrists[:, None] * torch.tensor([1.0, -1.0])
    only = torch.arange(3)[:, None, None] == 1
    found = examine_agreement(rig, replace(seen, joints2d=torch.where(only, off, seen.joints2d)))
    assert not any("look exchanged" in each.what for each in found)


def test_a_view_that_lies_aside_is_not_called_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where another time leaves far more of the disagreement than leaving the view out does."""
    take = make_take(60, views=4)
    rig, seen = CameraRig(tuple("abcd"), take.cameras), take.detections.without_poses()
    only = (torch.arange(4) == 1)[:, None, None]
    aside = replace(seen, joints2d=seen.joints2d + 60.0 * only * torch.tensor([1.0, 0.0]))

    def back(scene: Scene) -> Scene:
        joints = scene.detections.joints2d - 45.0 * only * torch.tensor([1.0, 0.0])
        return replace(scene, detections=replace(scene.detections, joints2d=joints))

    def late(scene: Scene, names: list[str]) -> Hypothesis:
        return Hypothesis("c", "looks 9 or so frames late", "", back)

    monkeypatch.setattr(agreement, "late_view", late)
    (found,) = examine_agreement(rig, aside)
    assert found.subject == "b" and "sees the person 60 px" in found.what


@pytest.mark.parametrize("aside", [0.0, 60.0])
def test_a_view_that_sees_nobody_is_not_to_blame(aside: float) -> None:
    """Its distance from what the others see is unknown; it was called infinite, and the worst."""
    take = make_take(60, views=5)
    seen, draw = take.detections.without_poses(), torch.Generator().manual_seed(1)
    confidence = seen.confidence2d.clone()
    confidence[:, 2] = 0.0
    noise = 3.0 * torch.randn(seen.joints2d.shape, generator=draw, dtype=torch.float64)
    joints = seen.joints2d + noise
    joints[:, 1, :, 0] += aside
    rig = CameraRig(tuple("abcde"), take.cameras)
    given = replace(seen, joints2d=joints, confidence2d=confidence)
    found = examine_agreement(rig, given)
    assert [each.subject for each in found] == (["b"] if aside else [])
    assert all("inf" not in each.what for each in found)
