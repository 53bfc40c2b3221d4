"""Findings of what is wrong throughout say in which views: joints of these are then doubted."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest
import torch
from doctored_views import NAMES, change_view, detections, one, rig, with_joints
from takes import make_take
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS, LANDMARKS16
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor import Finding, examine_agreement, examine_detections

MIRRORED = list(LANDMARKS16.mirrored())
EVERY = tuple(range(len(NAMES)))


def order(*pairs: tuple[str, str]) -> list[int]:
    names = list(range(len(LANDMARKS)))
    for pair in pairs:
        a, b = map(LANDMARKS.index, pair)
        names[a], names[b] = b, a
    return names


def of(views: Sequence[int], joints: Sequence[int]) -> Callable[[Tensor], None]:
    """Joints of some views in another order."""

    def change(pixels: Tensor) -> None:
        for view in views:
            pixels[:, view] = pixels[:, view][:, joints]

    return change


def aside(pixels: Tensor) -> None:
    pixels[:, 2] += torch.tensor([50.0, 0.0])


def smaller(pixels: Tensor) -> None:
    pixels[:, 1] *= 0.5


def later(pixels: Tensor) -> None:
    pixels[:, 3] = pixels[:, 3].roll(-5, 0)


MISTAKES: dict[str, tuple[Callable[[Tensor], None], tuple[int, ...]]] = {
    "from where the other views see": (aside, (2,)),
    "times the calibration's size": (smaller, (1,)),
    "frames early": (later, (3,)),
    "look swapped in this view": (of([1], MIRRORED), (1,)),
    "look exchanged in this view": (of([2], order(("l_wrist", "r_wrist"))), (2,)),
    "the feet point backwards": (of(EVERY, MIRRORED), EVERY),
    "x and y were exchanged": (lambda pixels: pixels.copy_(pixels.flip(-1)), EVERY),
}


@pytest.mark.long
@pytest.mark.parametrize("what", MISTAKES)
def test_of_four_views(what: str) -> None:
    change, views = MISTAKES[what]
    assert examine_agreement(rig(), detections()) == []
    found = examine_agreement(rig(), with_joints(detections(), change))
    wrong = [each for each in found if what in each.what]
    assert one(wrong).views == views and one(wrong).frames == ()


def test_views_that_are_exchanged() -> None:
    found = one(examine_agreement(rig(), detections().select([0, 3, 2, 1])))
    assert "look exchanged" in found.what and found.views == (1, 3)


def test_numbers_are_those_of_the_capture_where_a_view_is_left_out() -> None:
    turn = rotvec_to_matrix(torch.tensor([0.3, 0.14, 0.0], dtype=torch.float64))
    broken = change_view(rig(), 0, rotation=turn @ rig().cameras.rotation[0])
    first, second, *_ = examine_agreement(broken, with_joints(detections(), smaller))
    views = {each.subject: each.views for each in (first, second)}
    assert views == {"cam1": (0,), "cam2": (1,)}


def test_a_late_view_of_who_hardly_moves_is_not_doubted() -> None:
    take = make_take(60, views=4, lifted=False, rate=60)
    four = CameraRig(NAMES, take.cameras)
    late = take.detections.joints2d.clone()
    late[:, 1] = late[:, 1].roll(4, 0)
    late[:4, 1] = take.detections.joints2d[0, 1]
    found = one(examine_agreement(four, replace(take.detections, joints2d=late)))
    assert found.subject == "cam2" and "frames late" in found.what and found.views == ()


@pytest.mark.parametrize(
    "joints", [MIRRORED, order(("l_elbow", "l_wrist"), ("r_elbow", "r_wrist"))]
)
def test_of_two_views_either_may_be_wrong(joints: list[int]) -> None:
    take = make_take(60, views=2, lifted=False)
    pair = CameraRig(("a", "b"), take.cameras)
    assert examine_agreement(pair, take.detections) == []
    found = examine_agreement(pair, with_joints(take.detections, of([1], joints)))
    assert found and all(each.views == (0, 1) for each in found)


def alone(seen: Detections, view: int = 0) -> list[Finding]:
    """What is said of one view."""
    one_of = CameraRig((NAMES[view],), make_take(2, views=3).cameras.select([view]))
    return examine_detections(one_of, seen)


def test_3d_poses_and_frames_in_no_order() -> None:
    seen = make_take(40, views=1).detections
    assert alone(seen) == []
    poses = seen.joints3d
    assert poses is not None
    mixed = torch.randperm(40, generator=torch.Generator().manual_seed(0))
    wrong = {
        "runs against": replace(seen, joints3d=-poses),
        "mirror images": replace(seen, joints3d=(poses * torch.tensor([-1, 1, 1]))[:, :, MIRRORED]),
        "are flat": replace(seen, joints3d=poses * torch.tensor([1, 1, 0])),
        "do not follow one another": seen.frames(mixed),
    }
    for what, each in wrong.items():
        found = [finding for finding in alone(each) if what in finding.what]
        assert found and all(finding.views == (0,) for finding in found)
        assert not any(finding.frames for finding in found)


def test_what_is_corrected_is_not_doubted() -> None:
    """3D poses in another unit or about another origin: captures are as good as ever."""
    seen = make_take(40, views=1).detections
    assert seen.joints3d is not None
    for poses in (1000 * seen.joints3d, seen.joints3d + torch.tensor([0.0, 0.0, 3.0])):
        found = alone(replace(seen, joints3d=poses))
        assert found and not any(each.views for each in found)


@pytest.mark.long
def test_joints_that_are_held_for_long() -> None:
    """In a clip of any length, but not those between frames that a detector looked at."""
    seen = make_take(400, views=1).detections
    assert alone(seen) == []
    frame = torch.arange(400)
    stuck = torch.where((frame >= 200) & (frame < 212), 200, frame)
    found = one(alone(seen.frames(stuck)))
    assert "11 of 399 frames repeat the joints" in found.what and "frames 201-211 (" in found.what
    assert found.frames == tuple(range(201, 212)) and found.views == (0,)
    for every in (2, 5):
        skipped = one(alone(seen.frames(frame // every * every)))
        assert not skipped.frames and not skipped.views
    short = torch.where((frame >= 200) & (frame < 207), 200, frame)
    assert alone(seen.frames(short)) == []
