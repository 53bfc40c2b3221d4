"""Left and right of arms or legs alone that are exchanged in all views for a while."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from doctored_views import FRAMES, NAMES, change_view, detections, one, rig, with_joints
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.detections import read_detections
from perfcap.io.doctor import Severity, examine_agreement

DATA = Path(__file__).parents[3] / "shared" / "data" / "rendered_multi"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data beside this tree")
LIMBS = {"arms": range(2, 5), "legs": range(8, 12)}


def exchanged(seen: Detections, limbs: str, there: slice) -> Detections:
    mirror = LANDMARKS16.mirrored()
    order = list(range(16))
    for joint in LIMBS[limbs]:
        order[joint], order[mirror[joint]] = mirror[joint], joint
    joints, confidence = seen.joints2d.clone(), seen.confidence2d.clone()
    for values in (joints, confidence):
        values[there] = values[there][:, :, order]
    return replace(seen, joints2d=joints, confidence2d=confidence)


@pytest.mark.long
@pytest.mark.parametrize("limbs", ["arms", "legs"])
@pytest.mark.parametrize("there", [slice(6, 16), slice(12, FRAMES), slice(0, 9)])
@pytest.mark.parametrize("views", [2, 4])
def test_limbs_that_are_exchanged_for_a_while(views: int, there: slice, limbs: str) -> None:
    some = CameraRig(NAMES[:views], rig().cameras.select(list(range(views))))
    seen = detections().select(list(range(views)))
    assert examine_agreement(some, seen) == []
    finding = one(examine_agreement(some, exchanged(seen, limbs, there)))
    assert f"left and right of the {limbs} look exchanged in every view in frames" in finding.what
    assert finding.severity is Severity.WARNING and finding.views == tuple(range(views))
    assert len(set(finding.frames) ^ set(range(FRAMES)[there])) <= 1


@pytest.mark.long
@needs_data
@pytest.mark.parametrize(
    ("name", "limbs", "start", "stop"),
    [
        ("dev_views", "arms", 8, 20), ("dev_views", "legs", 8, 20), ("dev_views", "legs", 18, 36),
        ("dev_dance", "arms", 10, 25), ("dev_dance", "legs", 18, 40),
    ],
)  # fmt: skip
def test_the_same_of_people_who_move(name: str, limbs: str, start: int, stop: int) -> None:
    whole = read_cameras(DATA / name / "cameras.json")
    found = DATA / name / "person1" / "detections.npz"
    seen = read_detections([found], views=whole.names, pixel_offset=whole.pixel_offset)[0]
    views = [0, 2, 4]
    some = CameraRig(tuple(whole.names[view] for view in views), whole.cameras.select(views))
    seen = seen.select(views)
    assert examine_agreement(some, seen) == []
    finding = one(examine_agreement(some, exchanged(seen, limbs, slice(start, stop))))
    assert f"left and right of the {limbs} look exchanged" in finding.what
    assert len(set(finding.frames) ^ set(range(start, stop))) <= 2
    assert finding.views == (0, 1, 2)


def test_views_are_counted_as_given_where_one_is_left_out() -> None:
    """A view that is wrong everywhere is looked at no more; others keep their numbers."""
    turn = rotvec_to_matrix(torch.tensor([0.3, 0.14, 0.0], dtype=torch.float64))
    broken = change_view(rig(), 0, rotation=turn @ rig().cameras.rotation[0])

    def aside(joints: Tensor) -> None:
        joints[14:, 3] += torch.tensor([60.0, 0.0])

    found = examine_agreement(broken, with_joints(detections(), aside))
    assert found[0].subject == NAMES[0]
    partly = [each for each in found if each.frames]
    assert partly and {NAMES[view] for view in one(partly).views} >= {one(partly).subject}
