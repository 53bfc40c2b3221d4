"""Frames that are given as clips, and clips as frames."""

from __future__ import annotations

import warnings

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.pipeline import PoseRefiner

TAKE = make_take(24)
PIXELS = TAKE.detections.joints2d


def said(clips: Tensor) -> list[str]:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        PoseRefiner(TAKE.actor).eval()(TAKE.cameras, clips)
    return [str(each.message) for each in found if "follow one another" in str(each.message)]


def test_frames_of_a_motion_as_clips() -> None:
    """Each was solved on its own: three times the error on one recording."""
    (line,) = said(PIXELS[:, None])
    assert "24 clips of 1 frame follow one another" in line and "(F, C, J, 2)" in line


def test_exchanged_axes() -> None:
    clips = PIXELS.reshape(3, 8, *PIXELS.shape[1:])
    (line,) = said(clips.transpose(0, 1))
    assert "8 clips of 3 frames follow one another" in line and "clips first" in line


@pytest.mark.parametrize("length", [1, 3, 8])
def test_right_batches_are_not_named(length: int) -> None:
    shuffled = torch.randperm(24, generator=torch.Generator().manual_seed(0))
    clips = PIXELS[shuffled, None] if length == 1 else PIXELS.unfold(0, length, 2).movedim(-1, 1)
    assert said(clips) == []


@pytest.mark.parametrize("length", [1, 4])
def test_short_clips_show_together_what_each_does_not(length: int) -> None:
    """Sides, depth and axes are judged by ten frames or more."""
    poses = TAKE.detections.joints3d
    assert poses is not None
    shuffled = torch.randperm(24, generator=torch.Generator().manual_seed(0))
    parts = [each[shuffled] for each in (PIXELS, TAKE.detections.confidence2d, poses)]
    pixels, sure, poses = (each.unflatten(0, (-1, length)) for each in parts)
    exchanged = poses[..., [1, 0, 2]]

    def told(poses: Tensor, lead: int) -> list[str]:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            given = (each[:lead] for each in (pixels, sure, poses))
            PoseRefiner(TAKE.actor).eval()(TAKE.cameras, *given)
        return [str(each.message) for each in found if "clips together" in str(each.message)]

    (line, *_) = told(exchanged, 24)
    assert f"the {24 // length} clips together: view 0: x and y look exchanged" in line
    assert not told(poses, 24)
    assert not told(exchanged, 1)  # says nothing alone
