"""What is wrong in the last third of the frames, of which medians over the clip show nothing."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from doctored_views import FRAMES, NAMES, detections, one, person, rig, with_joints
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.calibration import CameraRig, read_cameras
from perfcap.io.detections import read_detections
from perfcap.io.doctor import Severity, examine_agreement

TAKE = Path(__file__).parents[3] / "shared" / "data" / "rendered_multi" / "dev_views"
FROM = 16  # of 24 frames
WHERE = f"frames {FROM}-{FRAMES - 1}"


def three() -> CameraRig:
    good = rig()
    return CameraRig(NAMES[:3], good.cameras.select([0, 1, 2]))


def taken(views: list[int]) -> tuple[CameraRig, Detections]:
    """Some views of a recording."""
    whole = read_cameras(TAKE / "cameras.json")
    found = TAKE / "person1" / "detections.npz"
    seen = read_detections([found], views=whole.names, pixel_offset=whole.pixel_offset)[0]
    return whole.select(views), seen.select(views)


def aside(joints: Tensor) -> Tensor:
    return joints + torch.tensor([40.0, 0.0])


def swapped(joints: Tensor) -> Tensor:
    return joints[..., list(LANDMARKS16.mirrored()), :]


def half(joints: Tensor) -> Tensor:
    return 0.5 * joints


def spoil(change: Callable[[Tensor], Tensor], view: int) -> Callable[[Tensor], None]:
    def spoiled(joints: Tensor) -> None:
        joints[FROM:, view] = change(joints[FROM:, view])

    return spoiled


@pytest.mark.long
@pytest.mark.parametrize("view", range(3))
@pytest.mark.parametrize("views", [3, 4])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (aside, "of their height or more from where the other views see them"),
        (swapped, "left and right joints look swapped in this view"),
        (half, "detections look as if made in an image 0.5 times"),
    ],
)
def test_a_view_that_is_wrong_in_the_end(
    change: Callable[[Tensor], Tensor], words: str, views: int, view: int
) -> None:
    some = three() if views == 3 else rig()
    seen = detections().select(list(range(views)))
    assert examine_agreement(some, seen) == []
    finding = one(examine_agreement(some, with_joints(seen, spoil(change, view))))
    assert finding.subject == NAMES[view] and words in finding.what
    assert finding.severity is Severity.WARNING  # the rest is captured as well as ever
    first = int(finding.what.split("in frames ")[1].split("-")[0])
    assert abs(first - FROM) <= 1 and f"-{FRAMES - 1} (of the capture" in finding.what
    assert finding.frames == tuple(range(first, FRAMES)) and finding.views == (view,)


def test_somebody_who_is_hidden_for_a_while_is_no_mistake() -> None:
    """Joints of one side are knocked aside where another passes; the rest stays."""
    seen = detections().select([0, 1, 2])

    def hidden(joints: Tensor) -> None:
        joints[FROM:, 1, 2:7] += 60.0

    assert examine_agreement(three(), with_joints(seen, hidden)) == []


def test_a_clip_hardly_longer_than_a_part_is_looked_at_as_a_whole() -> None:
    short = detections().select([0, 1, 2]).frames(slice(FROM - 12, FROM + 6))
    moved = short.joints2d.clone()
    moved[12:, 1] += 40.0
    assert examine_agreement(three(), replace(short, joints2d=moved)) == []


@pytest.mark.skipif(not TAKE.exists(), reason="needs the shared data beside this tree")
def test_of_two_views_that_fit_alike_with_sides_exchanged_the_right_one_is_named() -> None:
    """Exchanged in another one as well, the sides change places at that frame."""
    some, seen = taken([0, 2, 5])
    assert examine_agreement(some, seen) == []

    def late(joints: Tensor) -> None:
        joints[25:, 2] = swapped(joints[25:, 2])

    finding = one(examine_agreement(some, with_joints(seen, late)))
    assert finding.subject == "cam06" and "in frames 25-35" in finding.what


@pytest.mark.long
@pytest.mark.skipif(not TAKE.exists(), reason="needs the shared data beside this tree")
@pytest.mark.parametrize("start", [10, 18])
@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 2)])
def test_two_of_three_views_are_exchanged_in_half_of_the_clip(
    pair: tuple[int, int], start: int
) -> None:
    """More than half of the parts disagree then, and in one pair or the other sides turn over."""
    some, seen = taken([0, 2, 4])
    joints, confidence = seen.joints2d.clone(), seen.confidence2d.clone()
    for values in (joints, confidence):
        values[start:, list(pair)] = values[start:, list(reversed(pair))]
    spoiled = replace(seen, joints2d=joints, confidence2d=confidence)
    finding = one(examine_agreement(some, spoiled))
    assert finding.subject == " and ".join(some.names[view] for view in pair)
    assert finding.what.startswith(f"look exchanged in frames {start}-")
    assert finding.severity is Severity.WARNING and finding.views == pair
    assert finding.frames[0] == start and finding.frames[-1] >= 33


@pytest.mark.long
@pytest.mark.parametrize("views", [3, 4])
def test_sides_that_change_places_in_all_views(views: int) -> None:
    """Rays cross as well as before: the motion shows it, and the feet which frames are wrong."""
    some = CameraRig(NAMES[:views], rig().cameras.select(list(range(views))))
    seen = detections().select(list(range(views)))

    def exchanged(joints: Tensor) -> None:
        joints[FROM:] = swapped(joints[FROM:])

    assert examine_agreement(some, seen) == []
    finding = one(examine_agreement(some, with_joints(seen, exchanged)))
    assert finding.subject == "detections" and finding.severity is Severity.WARNING
    assert f"left and right look exchanged in every view in {WHERE}" in finding.what
    assert finding.frames == tuple(range(FROM, FRAMES)) and finding.views == tuple(range(views))


def test_somebody_who_turns_around_quickly_is_no_exchange() -> None:
    """By 24 degrees a frame, as in a pirouette."""
    turn = torch.arange(FRAMES, dtype=torch.float64) * torch.pi / 7.5
    spin = rotvec_to_matrix(torch.stack((0 * turn, turn, 0 * turn), -1))
    pixels = rig().cameras.project(person() @ spin.mT)
    noise = 4.0 * torch.randn(pixels.shape, generator=torch.Generator().manual_seed(0)).to(pixels)
    for views in ([0, 1], [0, 1, 2], [0, 1, 2, 3]):
        some = CameraRig(tuple(NAMES[view] for view in views), rig().cameras.select(views))
        seen = replace(detections(), joints2d=pixels + noise).select(views)
        assert examine_agreement(some, seen) == []


@pytest.mark.skipif(not TAKE.exists(), reason="needs the shared data beside this tree")
def test_legs_that_few_frames_of_two_views_lengthen_are_in_metres() -> None:
    views, seen = taken([1, 4])
    part = seen.frames(slice(24, 36))
    assert examine_agreement(views, part) == []
    for factor in (2.54, 3.28, 10.0, 100.0, 1000.0, 0.1):
        far = replace(views.cameras, translation=factor * views.cameras.translation)
        found = examine_agreement(replace(views, cameras=far), part)
        assert any("legs measure" in each.what for each in found), factor
