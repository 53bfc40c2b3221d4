"""One joint of both sides that is exchanged in every frame and view, as in a hand-made order."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.detections import read_detections
from perfcap.io.doctor import Finding, Severity, examine_agreement, examine_detections
from perfcap.io.doctor.pairs import examine_pairs

SKIRT = Path(__file__).parents[2] / "../shared/data/rendered/dev_skirt"
needs_data = pytest.mark.skipif(not SKIRT.exists(), reason="needs the shared data beside this tree")
PAIRS = ("elbow", "wrist", "knee", "ankle", "toe")


def exchanged(joints: Tensor, *names: str, axis: int = -2) -> Tensor:
    order = list(range(len(LANDMARKS)))
    for name in names:
        left, right = (LANDMARKS.index(f"{side}_{name}") for side in "lr")
        order[left], order[right] = right, left
    return joints.index_select(axis, torch.tensor(order))


def spoiled(seen: Detections, *names: str) -> Detections:
    poses = seen.joints3d
    return replace(
        seen,
        joints2d=exchanged(seen.joints2d, *names),
        confidence2d=exchanged(seen.confidence2d, *names, axis=-1),
        joints3d=None if poses is None else exchanged(poses, *names),
    )


def named(findings: list[Finding]) -> list[str]:
    """Joints that are said to be exchanged, of the left side."""
    (found,) = findings
    assert found.severity is Severity.ERROR and "shorter and steadier crosswise" in found.what
    pairs = found.what.split(" look exchanged")[0].split(", ")
    return sorted(pair.split(" and ")[0].removeprefix("l_") for pair in pairs)


@pytest.mark.long
@pytest.mark.parametrize(
    "names",
    [
        *((name,) for name in PAIRS),
        ("wrist", "toe"),
        ("elbow", "wrist"),
        ("knee", "ankle", "toe"),
        ("knee", "ankle"),
        ("ankle", "toe"),
        ("elbow", "wrist", "ankle", "toe"),
    ],
)
def test_exchanged_joints_are_named(names: tuple[str, ...]) -> None:
    take = make_take(60, views=3)
    rig = CameraRig(("a", "b", "c"), take.cameras)
    flat = take.detections.without_poses()
    assert examine_agreement(rig, flat) == []
    assert named(examine_agreement(rig, spoiled(flat, *names))) == sorted(names)
    one = make_take(60)
    alone = CameraRig(("a",), one.cameras)
    assert examine_detections(alone, one.detections) == []
    assert named(examine_detections(alone, spoiled(one.detections, *names))) == sorted(names)


def test_joints_that_are_seldom_known_say_nothing() -> None:
    take = make_take(60)
    joints = take.actor.joints(take.truth)
    wrong = exchanged(joints, "wrist")
    assert named(examine_pairs("a", wrong)) == ["wrist"]
    few = wrong.clone()
    few[9:, LANDMARKS.index("l_wrist")] = torch.nan
    assert examine_pairs("a", few) == []


def test_who_folds_their_hands_or_stands_still_is_left_alone() -> None:
    """Wrists at one place, and a pose that never changes with errors of some centimetres."""
    take = make_take(60)
    joints = take.actor.joints(take.truth)
    noise = torch.randn(joints.shape, generator=torch.Generator().manual_seed(0)).to(joints)
    folded = joints.clone()
    left, right = (LANDMARKS.index(f"{side}_wrist") for side in "lr")
    folded[:, left] = folded[:, right] = 0.5 * (joints[:, left] + joints[:, right])
    for case in (folded, folded + 0.03 * noise, joints[:1] + 0.03 * noise, joints + 0.06 * noise):
        assert examine_pairs("a", case) == []


@needs_data
@pytest.mark.parametrize(("start", "stop"), [(0, 20), (2, 22), (9, 21), (18, 28)])
def test_right_joints_of_a_short_clip_are_quiet(start: int, stop: int) -> None:
    """Errors that stay for a while, of who hardly moves, are no exchange of ankles or toes."""
    whole = read_cameras(SKIRT / "camera.json")
    seen = read_detections([SKIRT / "detections.npz"], views=whole.names)[0]
    part = seen.frames(slice(start, stop))
    assert [each for each in examine_detections(whole, part) if "exchanged" in each.what] == []
    for names in (("elbow",), ("elbow", "wrist")):  # which are no less named
        assert any(
            "crosswise" in each.what for each in examine_detections(whole, spoiled(part, *names))
        )
