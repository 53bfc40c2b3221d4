"""Joints that are late against the video, as a network sees the person in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from perfcap.detect.detections import Detections
from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.known_person import OPPOSITE
from perfcap.io.actor import models_folder
from perfcap.io.calibration import PixelMap, read_cameras
from perfcap.io.clip import Clip
from perfcap.io.detections import read_detections
from perfcap.io.doctor import Severity
from perfcap.io.doctor.inputs import examine_take
from perfcap.io.doctor.looked import _size, examine_looks

DEMO = models_folder() / "demo"
CLIP = Clip.open([DEMO / "video.mp4"])
RIG = read_cameras(DEMO / "camera.json", CLIP.sizes)
SEEN = read_detections([DEMO / "detections.npz"], views=RIG.names)[0]


def late(frames: int) -> Detections:
    count = SEEN.frame_count
    return SEEN.map(lambda part: part[(torch.arange(count) - frames).clamp(0, count - 1)])


def said(frames: int, pixels: Tensor | None = None) -> list[str]:
    given = late(frames)
    pixels = given.joints2d if pixels is None else pixels
    found = examine_looks(CLIP, given.confidence2d, pixels)
    assert all(each.severity is Severity.WARNING for each in found)
    return [each.what for each in found]


@pytest.mark.long
@pytest.mark.parametrize(
    ("frames", "words"), [(3, "3 or so frames late"), (-4, "4 or so frames e")]
)
def test_joints_of_other_frames(frames: int, words: str) -> None:
    (line,) = said(frames)
    assert words in line


@pytest.mark.long
def test_right_joints() -> None:
    assert said(0) == said(1) == []


@pytest.mark.long
def test_joints_of_the_other_side() -> None:
    other = SEEN.joints2d[..., OPPOSITE, :], SEEN.confidence2d[..., OPPOSITE]
    (found,) = examine_looks(CLIP, other[1], other[0])
    assert "left and right look exchanged" in found.what
    assert (found.severity, found.views) == (Severity.ERROR, (0,))
    some = torch.cat((other[0][:10], SEEN.joints2d[10:]))
    assert examine_looks(CLIP, SEEN.confidence2d, some) == []


@pytest.mark.long
def test_joints_of_another_video() -> None:
    """Upside down they are in the right place."""
    middle = SEEN.joints2d.mean(-2, keepdim=True)
    (line,) = said(0, 2 * middle - SEEN.joints2d)
    assert "of another video or person, or others stand before them" in line
    upside = 2 * middle - SEEN.joints2d
    assert examine_looks(CLIP, SEEN.confidence2d, upside, alone=False) == []
    both = Clip.open([DEMO / "video.mp4"] * 2)
    joints, sure = torch.cat((SEEN.joints2d, upside), 1), SEEN.confidence2d.expand(-1, 2, -1)
    (found,) = examine_looks(both, sure, joints, ("left", "right"))
    assert found.subject == "right" and "in the same order" in found.remedy


@pytest.mark.long
@pytest.mark.parametrize(
    ("stretch", "shift", "words"),
    [
        ((1, 0.9), (0, 0), "above where"),
        ((1, 1), (0, 40), "below where"),
        ((1, 1), (25, 0), "to the right of where"),
        ((0.94, 1), (0, 0), "to the left of where"),
    ],
)
def test_joints_of_a_resized_picture(
    stretch: tuple[float, float], shift: tuple[float, float], words: str
) -> None:
    """As of a network's square input, or of a picture that was cropped or padded."""
    pixels = SEEN.joints2d * torch.tensor(stretch) + torch.tensor(shift)
    (line,) = said(0, pixels)
    assert "of the person's size " + words in line


@pytest.mark.long
def test_whom_a_network_sees_may_be_any_of_several_people() -> None:
    """One who stands before another is seen in the other's place; wrong are joints of nobody."""
    middle = SEEN.joints2d.mean(-2, keepdim=True)
    hidden, sure = 2 * middle - SEEN.joints2d, SEEN.confidence2d
    people = torch.stack((hidden, SEEN.joints2d)), torch.stack((sure, sure))
    assert examine_looks(CLIP, sure, hidden, everybody=people) == []
    assert examine_looks(CLIP, sure, SEEN.joints2d, everybody=people) == []
    people = torch.stack((hidden, SEEN.joints2d + 300)), torch.stack((sure, sure))
    (found,) = examine_looks(CLIP, sure, hidden, everybody=people)
    assert "of another video or person" in found.what


def test_the_size_of_who_is_cut_off() -> None:
    whole = SEEN.joints2d[0, 0].double().numpy().copy()
    cut = whole.copy()
    legs = [LANDMARKS.index(f"{side}_{part}") for side in "rl" for part in ("knee", "ankle", "toe")]
    cut[legs] = np.nan
    assert 0.75 < _size(cut) / _size(whole) < 1.3


def test_where_the_network_sees_nobody() -> None:
    """Elsewhere in the image, or never: nothing is nearer than anything else."""
    assert said(5, late(5).joints2d * 0.3) == []
    assert said(5, torch.full_like(SEEN.joints2d, torch.nan)) == []


@pytest.mark.long
def test_whatever_the_camera_does() -> None:
    """Before a camera that moves, or is said to, no check of moving pixels says anything."""
    count = SEEN.frame_count
    cameras = RIG.cameras.every_frame(count)
    moving = replace(RIG, cameras=cameras)
    there = PixelMap(torch.eye(3, dtype=torch.float64)[None])
    for frames, told in ((0, False), (5, True)):
        found = examine_take(moving, late(frames), CLIP, there)
        assert any("frames late against the video" in each.what for each in found) == told
    found = examine_take(moving, late(5), CLIP, there, detected=True)
    assert not any("against the video" in each.what for each in found)


@pytest.mark.long
def test_takes_of_several_people() -> None:
    """Joints of another video are named of people, too, where those of all are known."""
    upside = replace(SEEN, joints2d=2 * SEEN.joints2d.mean(-2, keepdim=True) - SEEN.joints2d)
    there = PixelMap(torch.eye(3, dtype=torch.float64)[None])
    moved = replace(upside, joints2d=upside.joints2d + 200)
    everybody = Detections.stack((upside, moved))
    for people, told in ((None, False), (everybody, True)):
        found = examine_take(RIG, upside, CLIP, there, alone=False, everybody=people)
        assert any("of another video or person" in each.what for each in found) == told
