"""Sound views of people who lie, cameras on their sides, and half figures: nothing is named."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from synthetic import actor as person
from synthetic import cameras as circle
from takes import F64, Take, detect, make_take, sway
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.geometry.camera import Camera
from perfcap.geometry.rotation import matrix_to_rotvec, rotvec_to_matrix
from perfcap.io.calibration import CameraRig
from perfcap.io.doctor.agreement import examine_agreement
from perfcap.io.doctor.cameras import examine_cameras
from perfcap.io.doctor.finding import Finding
from perfcap.pipeline.config import ContactConfig, PoseConfig
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.presets import CaptureConfig

FRAMES, VIEWS = 24, 3
LEGS = [LANDMARKS.index(f"{s}_{joint}") for s in "lr" for joint in ("knee", "ankle", "toe")]


def noisy(take: Take, detections: Detections, share: float) -> Detections:
    """With errors that are a share of how tall the person is who stands."""
    generator = torch.Generator().manual_seed(3)
    noise = torch.randn(detections.joints2d.shape, generator=generator, dtype=F64)
    unit = take.detections.person_height()[:, None, None]
    return replace(detections, joints2d=detections.joints2d + share * unit * noise)


def findings(cameras: Camera, detections: Detections) -> list[Finding]:
    names = tuple(f"cam{view}" for view in range(detections.views))
    return examine_agreement(CameraRig(names, cameras), detections)


def on_their_sides(cameras: Camera, pixels: Tensor) -> tuple[Camera, Tensor]:
    """Cameras (C,) turned by 90 degrees, and pixels (F, C, 16, 2) as these see them."""
    turn = rotvec_to_matrix(torch.tensor([0.0, 0.0, torch.pi / 2], dtype=F64))
    heights = torch.tensor([height for height, _ in cameras.size], dtype=F64)
    own = cameras.intrinsics
    intrinsics = own.clone()
    intrinsics[:, 0, 0], intrinsics[:, 1, 1] = own[:, 1, 1], own[:, 0, 0]
    intrinsics[:, 0, 2], intrinsics[:, 1, 2] = heights - 1 - own[:, 1, 2], own[:, 0, 2]
    turned = replace(
        cameras,
        intrinsics=intrinsics,
        rotation=turn @ cameras.rotation,
        translation=cameras.translation @ turn.mT,
        size=tuple((width, height) for height, width in cameras.size),
    )
    x, y = pixels.unbind(-1)
    return turned, torch.stack((heights[:, None] - 1 - y, x), dim=-1)


def test_cameras_on_their_sides_see_as_much() -> None:
    take = make_take(FRAMES, views=VIEWS, lifted=False)
    seen = noisy(take, take.detections, 0.02)
    cameras, pixels = on_their_sides(take.cameras, seen.joints2d)
    turned = replace(seen, joints2d=pixels)
    assert findings(take.cameras, seen) == findings(cameras, turned) == []
    # a camera that stands straight in the world hints at what is up there, one on its side does not
    config = CaptureConfig(PoseConfig(contact=ContactConfig(enabled=False)))
    upright, aside = (
        capture(take.actor, *inputs, take.rate, config)
        for inputs in ((take.cameras, seen), (cameras, turned))
    )
    assert upright.warnings == aside.warnings == ()
    torch.testing.assert_close(aside.joints(), upright.joints(), atol=1e-6, rtol=0)


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
def test_who_lies_is_as_large(axis: list[float]) -> None:
    take = make_take(FRAMES, views=VIEWS, lifted=False)
    down = rotvec_to_matrix(torch.pi / 2 * torch.tensor(axis, dtype=F64))
    turned = matrix_to_rotvec(down @ rotvec_to_matrix(take.truth.rotation))
    lying = replace(take.truth, rotation=turned)
    seen = noisy(take, detect(take.actor, take.cameras, lying, lifted=False), 0.02)
    assert findings(take.cameras, seen) == []


@pytest.mark.parametrize("times", [14.0, 0.45])
def test_stadiums_and_small_children(times: float) -> None:
    """Cameras far away with long lenses, and everything smaller, as one who just stands sees it."""
    take = make_take(FRAMES, views=VIEWS, lifted=False)
    cameras = take.cameras
    if times > 1:
        longer = cameras.intrinsics * torch.tensor([times, times, 1.0], dtype=F64).diag()
        longer[..., 2] = cameras.intrinsics[..., 2]
        middle = cameras.rotation @ take.truth.translation.mean(0)
        near = cameras.translation + middle
        away = torch.tensor([1.0, 1.0, times], dtype=F64)
        cameras = replace(cameras, intrinsics=longer, translation=near * away - middle)
        seen = detect(take.actor, cameras, take.truth, lifted=False)
        assert torch.pdist(cameras.centre).max() > 100
    else:
        cameras = replace(cameras, translation=times * cameras.translation)
        seen = take.detections
    rig = CameraRig(("a", "b", "c"), cameras)
    assert examine_cameras(rig) == findings(cameras, seen) == []


def test_half_figures_have_no_knees_in_the_place_of_hips() -> None:
    take = make_take(FRAMES, views=VIEWS, lifted=False)
    seen = noisy(take, take.detections, 0.01)
    hips = [LANDMARKS.index(f"{s}_hip") for s in "lr"]
    pixels, confidence = seen.joints2d.clone(), seen.confidence2d.clone()
    pixels[:, 0, hips] += 0.05 * take.detections.person_height()[0]  # as detectors place them
    confidence[..., LEGS] = 0
    half = replace(seen, joints2d=pixels, confidence2d=confidence)
    assert findings(take.cameras, half) == []


def with_slow_errors(seen: Detections, pixels: float, seed: int) -> Detections:
    """As networks make them: of a joint they stay for several frames."""
    generator = torch.Generator().manual_seed(seed)
    errors = torch.randn(seen.joints2d.shape, generator=generator, dtype=F64)
    for before, now in pairwise(errors):
        now.mul_(0.44).add_(0.9 * before)
    return replace(seen, joints2d=seen.joints2d + pixels * errors)


def between(cameras: Camera) -> Detections:
    """Of a person whose neck is as high as the cameras: where two face each other, between them."""
    actor = person()
    moved = sway(actor, FRAMES, 30.0)
    lower = moved.translation - torch.tensor([0.0, 0.5, 0.0])
    return detect(actor, cameras, replace(moved, translation=lower), lifted=False)


def test_two_of_three_views_that_face_each_other_accuse_no_third() -> None:
    """They hardly place a joint on the line between them: "sees the person 27 px from where"."""
    cameras = circle(4, size=600).select([0, 1, 2])
    seen = between(cameras)
    for seed in range(6, 11):
        found = findings(cameras, with_slow_errors(seen, 5.0, seed))
        assert not any("sees the person" in each.what for each in found)


def test_a_third_view_is_accused_of_what_it_sees_beside_their_line() -> None:
    cameras = circle(4, size=600).select([0, 1, 2])
    seen = between(cameras)
    joints = seen.joints2d.clone()
    joints[:, 1, :, 1] += 60  # along the line between the others nothing shows it
    found = findings(cameras, with_slow_errors(replace(seen, joints2d=joints), 1.0, 0))
    assert any("cam1" in each.subject and "sees the person" in each.what for each in found)


def test_views_next_to_each_other_have_their_size() -> None:
    """Errors are smaller in smaller images: "made in images 1.5 times the size"."""
    cameras = circle(24, size=600).select([0, 1])
    seen = between(cameras)
    for seed in range(5, 10):
        found = findings(cameras, with_slow_errors(seen, 5.0, seed))
        assert not any("times the size" in each.what for each in found)
