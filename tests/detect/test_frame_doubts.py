"""Frames of several people in no order are said to be, those in order never."""

from dataclasses import replace

import pytest
import torch
from crowds import RATE, make_crowd

from perfcap.detect.association import associate
from perfcap.detect.association.frame_doubts import frame_doubts
from perfcap.errors import InputError


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [1, 2, 3])
def test_frames_in_order_are_not_doubted(seed: int, count: int) -> None:
    crowd = make_crowd(seed, count=count, spoil=0.3, noise=6.0)
    for start in range(0, crowd.candidates.frame_count - 8, 6):
        for length in (12, 20, 40):
            part = crowd.candidates.frames(slice(start, start + length))
            assert list(frame_doubts(part)) == []


@pytest.mark.long
@pytest.mark.parametrize("count", [2, 3])
def test_frames_in_no_order_are_named(count: int) -> None:
    crowd = make_crowd(1, count=count)
    frames = crowd.candidates.frame_count
    mixed = torch.randperm(frames, generator=torch.Generator().manual_seed(1))
    try:
        said = associate(crowd.cameras, crowd.candidates.frames(mixed), RATE).notes
    except InputError as error:
        said = (str(error),)
    assert any("do not follow one another" in line for line in said)


def test_frames_sorted_as_text_are_named() -> None:
    crowd = make_crowd(1)
    frames = crowd.candidates.frame_count
    order = torch.tensor(sorted(range(frames), key=str))
    (said,) = frame_doubts(crowd.candidates.frames(order))
    assert "sorted as text (1, 10, 2)" in said


def test_who_stands_may_be_in_any_order() -> None:
    crowd = make_crowd(1, count=2, noise=6.0)
    still = crowd.candidates.frames(torch.zeros(30, dtype=torch.long))
    noise = 2 * torch.randn(still.joints2d.shape, generator=torch.Generator().manual_seed(0))
    shaken = replace(still, joints2d=still.joints2d + noise)
    assert list(frame_doubts(shaken)) == []
