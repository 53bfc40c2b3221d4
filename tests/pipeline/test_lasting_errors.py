"""3D poses that are wrong for long beside joints of several views, which know better."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from takes import F64, Take, make_take

from perfcap.commands.capture import Capture
from perfcap.errors import InputError
from perfcap.pipeline import CaptureConfig, PositionConfig, capture


def error(take: Take, lasting: float = PositionConfig().lasting) -> float:
    settings = CaptureConfig()
    pose = replace(settings.pose, position=PositionConfig(lasting=lasting))
    parts = take.actor, take.cameras, take.detections, take.rate
    return float(take.error_mm(capture(*parts, replace(settings, pose=pose)).joints()).mean())


@pytest.mark.long
def test_a_lasting_error_of_3d_poses_moves_two_views_little() -> None:
    """Joints that a lifter sees 12 cm off all the time; pixels are off by two, at random."""
    take = make_take(45, views=2)
    random = torch.Generator().manual_seed(0)
    pixels = take.detections.joints2d
    noise = 2 * torch.randn(pixels.shape, generator=random, dtype=F64)
    poses = take.detections.joints3d
    assert poses is not None
    wrong = poses + 0.07 * torch.randn(1, 1, 16, 3, generator=random, dtype=F64)
    seen = replace(take.detections, joints2d=pixels + noise, joints3d=wrong)
    plain = error(replace(take, detections=replace(seen, joints3d=None)))
    found = error(replace(take, detections=seen))
    assert found < 1.15 * plain
    assert error(replace(take, detections=seen), lasting=1.0) > 1.2 * found


def test_one_view_needs_its_3d_poses_whole() -> None:
    config = PositionConfig(weight=2.0, lasting=8.0)
    assert [config.weight_of(views) for views in (1, 2, 6)] == [2.0, 0.25, 0.25]
    with pytest.raises(InputError, match="lasting of PositionConfig"):
        PositionConfig(lasting=0.0)


def test_one_and_two_videos_are_lifted() -> None:
    videos = tuple(Path(f"{n}.mp4") for n in range(3))
    lifted = [Capture(videos=videos[: n + 1], out=Path("out")).lifters for n in range(3)]
    assert lifted == [("cmu",), ("cmu",), ()]
    assert Capture(videos=videos[:2], out=Path("out"), lifter="none").lifters == ()
