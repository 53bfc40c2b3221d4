"""3D poses and 2D joints of which one is mirrored, sides and all, and the other is not."""

import warnings

import pytest
import torch
from torch import Tensor

import perfcap
from perfcap.detect import Detections
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.io import models_folder
from perfcap.pipeline import PoseRefiner
from perfcap.pipeline.input_doubts import input_doubts

DEMO = models_folder() / "demo"
SEEN = perfcap.read_detections([DEMO / "detections.npz"])[0]
CAMERAS = perfcap.read_cameras(DEMO / "camera.json").cameras
ORDER = list(LANDMARKS16.mirrored())


def mirrored(joints: Tensor, middle: float = 0.0) -> Tensor:
    """Joints (..., 16, D) with x about a middle, and left and right exchanged."""
    flipped = joints[..., ORDER, :].clone()
    flipped[..., 0] = 2 * middle - flipped[..., 0]
    return flipped


def said(pixels: Tensor, confidence: Tensor, poses: Tensor) -> list[str]:
    seen = Detections.from_joints(pixels, confidence, poses)
    return [line for line in input_doubts(CAMERAS, seen) if "mirror images" in line]


@pytest.mark.long
@pytest.mark.parametrize("part", [slice(0, 40), slice(40, 80), slice(80, 120)])
def test_joints_that_are_mirrored_in_2d_or_3d_alone(part: slice) -> None:
    """As where images are flipped to have more of them, with one kind of joints forgotten."""
    seen = SEEN.frames(part)
    assert seen.joints3d is not None
    middle = float(CAMERAS.intrinsics[0, 0, 2])
    pixels, poses = mirrored(seen.joints2d, middle), mirrored(seen.joints3d)
    sure = seen.confidence2d[..., ORDER]
    for one in said(pixels, sure, seen.joints3d), said(seen.joints2d, seen.confidence2d, poses):
        (line,) = one
        assert "left and right exchanged" in line and "mirror both or neither" in line
    assert not said(seen.joints2d, seen.confidence2d, seen.joints3d)
    assert not said(pixels, sure, poses)


def test_who_stands_the_same_on_both_sides_is_not_named() -> None:
    assert SEEN.joints3d is not None
    poses = 0.5 * (SEEN.joints3d + mirrored(SEEN.joints3d))
    placed = poses + poses.new_tensor([0.0, 0.0, 4.0])
    pixels = CAMERAS.project_camera(placed)
    noise = torch.randn(pixels.shape, generator=torch.Generator().manual_seed(0)).to(pixels)
    assert not said(pixels + 5 * noise, torch.ones_like(SEEN.confidence2d), poses)
    assert not said(pixels + 5 * noise, torch.ones_like(SEEN.confidence2d), mirrored(poses))


@pytest.mark.long
def test_images_of_a_batch_show_it_together() -> None:
    """Each shows too little by itself."""
    assert SEEN.joints3d is not None
    some = torch.randperm(120, generator=torch.Generator().manual_seed(0))[:16]
    seen, poses = SEEN.frames(some), mirrored(SEEN.joints3d[some])
    refiner = PoseRefiner(perfcap.load_actor("sam")).eval()
    images = [part.unsqueeze(1) for part in (seen.joints2d, seen.confidence2d, poses)]
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        refiner(CAMERAS, *images)
    told = [str(each.message) for each in found]
    (line,) = [line for line in told if "the 16 clips together" in line]
    assert "mirror images" in line
