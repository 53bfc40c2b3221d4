"""Ways of all moving cameras that are some frames late against the joints of their views."""

from dataclasses import replace

import pytest
import torch
from synthetic import cameras as circle
from takes import Take, detect, make_take
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import rotvec_to_matrix
from perfcap.io.doctor import Finding, Severity
from perfcap.io.doctor.given import examine_given
from perfcap.pipeline import PoseRefiner, capture
from perfcap.pipeline.trust import THRESHOLD

FRAMES = 60
WORDS = "the ways of all cameras look"


def carried(views: int, seed: int = 1) -> Camera:
    """Cameras in hands, (F, C), each of which shakes in its own way."""
    generator = torch.Generator().manual_seed(seed)
    time = torch.arange(FRAMES, dtype=torch.float64)[:, None, None] / 30

    def shaken(size: float) -> Tensor:
        pace = 4 + 6 * torch.rand(views, 3, generator=generator, dtype=torch.float64)
        start = 6.3 * torch.rand(views, 3, generator=generator, dtype=torch.float64)
        return size * torch.sin(pace * time + start)

    still = circle(max(views, 3), size=600).select(list(range(views)))
    return replace(
        still,
        intrinsics=still.intrinsics.expand(FRAMES, -1, -1, -1),
        rotation=rotvec_to_matrix(shaken(0.03)) @ still.rotation,
        translation=still.translation + shaken(0.1),
    )


def filmed(views: int, pixels: float = 3.0, seed: int = 1) -> tuple[Take, Camera, Detections]:
    """A take, cameras that move, and noisy joints without 3D poses."""
    take, cameras = make_take(FRAMES, views=views, lifted=False), carried(views, seed)
    seen = detect(take.actor, cameras, take.truth, lifted=False)
    noise = torch.randn(seen.joints2d.shape, generator=torch.Generator().manual_seed(seed))
    return take, cameras, replace(seen, joints2d=seen.joints2d + pixels * noise.double())


def late(cameras: Camera, frames: int, views: slice = slice(None)) -> Camera:
    """The poses of so many frames before, of some views."""
    index = (torch.arange(FRAMES) - frames).clamp(0, FRAMES - 1)
    rotation, translation = cameras.rotation.clone(), cameras.translation.clone()
    rotation[:, views], translation[:, views] = rotation[index, views], translation[index, views]
    return replace(cameras, rotation=rotation, translation=translation)


def said(cameras: Camera, seen: Detections) -> list[Finding]:
    return [each for each in examine_given(cameras, seen) if WORDS in each.what]


@pytest.mark.parametrize(("views", "frames"), [(2, 4), (2, -5), (3, 6), (4, 4)])
def test_late_ways_of_all_cameras_are_named(views: int, frames: int) -> None:
    _, cameras, seen = filmed(views)
    assert examine_given(cameras, seen) == ()
    (found,) = examine_given(late(cameras, frames), seen)
    way = "late" if frames > 0 else "early"
    assert found.what.startswith(f"{WORDS} {abs(frames)} or so frames {way}")
    assert "give the pose of each frame to that frame" in found.remedy
    assert found.severity is Severity.ERROR and found.views == tuple(range(views))


@pytest.mark.parametrize("views", [2, 3])
@pytest.mark.parametrize("pixels", [1.0, 5.0])
def test_right_ways_are_in_time(views: int, pixels: float) -> None:
    for seed in (2, 3):
        take, cameras, seen = filmed(views, pixels, seed)
        assert said(cameras, seen) == []
        for count in (10, 14, 30):
            part = slice(0, count)
            assert said(cameras.frames(part), seen.frames(part)) == []
        still = take.truth.map(lambda part: part[:1].expand(FRAMES, *part.shape[1:]))
        noise = seen.joints2d - detect(take.actor, cameras, take.truth, False).joints2d
        rest = detect(take.actor, cameras, still, False)
        assert said(cameras, replace(rest, joints2d=rest.joints2d + noise)) == []


def test_cameras_that_stand_have_no_late_ways() -> None:
    take, cameras, _ = filmed(2)
    fixed = cameras.map(lambda each: each[:1].expand(FRAMES, *each.shape[1:]))
    seen = detect(take.actor, fixed, take.truth, lifted=False)
    noise = torch.randn(seen.joints2d.shape, generator=torch.Generator().manual_seed(1)).double()
    assert said(fixed, replace(seen, joints2d=seen.joints2d + 3 * noise)) == []


@pytest.mark.parametrize("views", [2, 3])
def test_one_late_view_is_not_all(views: int) -> None:
    """Neither its way alone, nor its joints."""
    _, cameras, seen = filmed(views)
    for frames in (-5, 4, 10):
        assert said(late(cameras, frames, slice(0, 1)), seen) == []
        index = (torch.arange(FRAMES) - frames).clamp(0, FRAMES - 1)
        joints = seen.joints2d.clone()
        joints[:, 1] = joints[index, 1]
        assert said(cameras, replace(seen, joints2d=joints)) == []


@pytest.mark.long
def test_captures_say_it_and_trust_no_frame() -> None:
    take, cameras, seen = filmed(2)
    wrong = capture(take.actor, late(cameras, 4), seen, take.rate)
    assert any(WORDS in line for line in wrong.warnings)
    assert wrong.trust is not None and (wrong.trust.value < THRESHOLD).all()


@pytest.mark.long
def test_the_refiner_warns_of_it() -> None:
    take, cameras, seen = filmed(2)
    refiner = PoseRefiner(take.actor, joint_set="landmarks16", rate=30.0).eval()
    with pytest.warns(UserWarning, match=WORDS):
        refiner(late(cameras, 4), seen.joints2d, confidence2d=seen.confidence2d)
