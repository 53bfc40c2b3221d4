"""3D poses that are a few frames late against the 2D joints of their view."""

from __future__ import annotations

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.io import models_folder, read_cameras, read_detections
from perfcap.io.doctor import Finding, Severity, examine_detections
from perfcap.io.doctor.lifted import examine_lifted

TAKE = make_take(120)


def noise(size: float, *shape: int) -> Tensor:
    seed = torch.Generator().manual_seed(0)
    return size * torch.randn(*shape, generator=seed, dtype=torch.float64)


def examined(late: int, frames: int, *, successive: bool = True) -> list[Finding]:
    """Of poses with errors as large as what two frames make of this motion."""
    poses, plane = TAKE.detections.joints3d, TAKE.cameras.to_plane(TAKE.detections.joints2d)
    assert poses is not None
    poses = poses[:, 0] + noise(0.05, 120, 16, 3)
    index = (torch.arange(frames) - late).clamp(0, 119)
    sure, trusted = torch.ones(frames, 16), torch.ones(frames, dtype=torch.bool)
    return examine_lifted(
        "a", poses[index], plane[:frames, 0], sure, trusted, successive=successive
    )


@pytest.mark.parametrize(("late", "words"), [(2, "2 frames late"), (-2, "2 frames early")])
def test_two_frames_are_named_where_most_of_a_clip_shows_them(late: int, words: str) -> None:
    (found,) = examined(late, 100)
    assert found.severity is Severity.WARNING and words in found.what


def test_poses_in_time_short_clips_and_images_in_no_order_are_not() -> None:
    assert not examined(0, 100)
    assert not examined(2, 40)
    assert not examined(2, 100, successive=False)


def test_frames_that_are_left_fit_better_anyway() -> None:
    """Of who stands, joints were bad at the end: poses looked half the clip late."""
    poses, plane = TAKE.detections.joints3d, TAKE.cameras.to_plane(TAKE.detections.joints2d)
    assert poses is not None
    still = poses[:1, 0] + noise(0.02, 60, 16, 3)
    seen = plane[:1, 0].expand(60, 16, 2).clone()
    seen[30:] += noise(0.02, 30, 16, 2)
    sure, trusted = torch.ones(60, 16), torch.ones(60, dtype=torch.bool)
    assert not examine_lifted("a", still, seen, sure, trusted)


@pytest.mark.parametrize(("first", "last"), [(80, 95), (90, 105), (20, 35)])
def test_short_clips_are_not_late(first: int, last: int) -> None:
    """Of so few frames some shift always leaves less."""
    demo = models_folder() / "demo"
    rig = read_cameras(demo / "camera.json")
    given, _ = read_detections([demo / "detections.npz"], views=rig.names)
    told = examine_detections(rig, given.frames(slice(first, last)), coverage=False)
    assert not [each for each in told if "against the 2D joints" in each.what]
