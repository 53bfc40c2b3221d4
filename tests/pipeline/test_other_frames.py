"""Joints that are given beside a capture, and are of other frames."""

from __future__ import annotations

import warnings
from dataclasses import replace

import pytest
import torch
from takes import make_take

from perfcap.detect.detections import Detections
from perfcap.pipeline.input_doubts import warn_of_other_joints

FRAMES = 20
TAKE = make_take(FRAMES + 16, views=3)
SEEN = Detections.from_joints(TAKE.detections.joints2d, TAKE.detections.confidence2d)
CAPTURED = SEEN.frames(slice(8, 8 + FRAMES))
HEIGHT = torch.full((3,), float(SEEN.joints2d[..., 1].max() - SEEN.joints2d[..., 1].min()))


def told(given: Detections, kept: Detections = CAPTURED) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_other_joints(given, kept, HEIGHT.to(kept.joints2d))
    return [str(each.message) for each in caught]


def aside(seen: Detections, off: torch.Tensor) -> Detections:
    """Joints beside where they were, by shares of the person's height."""
    return replace(seen, joints2d=seen.joints2d + off * HEIGHT[0])


@pytest.mark.parametrize(
    ("shift", "words"), [(-4, "4 frames earlier"), (2, "2 frames later"), (8, "8 frames later")]
)
def test_joints_of_other_frames_are_told(shift: int, words: str) -> None:
    given = SEEN.frames(slice(8 + shift, 8 + shift + FRAMES))
    (line,) = told(given)
    assert line.startswith("detections of views [0, 1, 2] look like those of other frames: 0.0%")
    assert f"capture {words}," in line
    (line,) = told(aside(given, 0.003 * torch.randn(given.joints2d.shape)))
    assert words in line
    pixels = given.joints2d.clone().requires_grad_()
    (line,) = told(Detections.from_joints(pixels, given.confidence2d))
    assert words in line


def test_joints_in_reversed_order_are_told() -> None:
    (line,) = told(CAPTURED.map(lambda part: part.flip(0)))
    assert "capture in reversed order," in line


def test_joints_of_one_late_view_are_told() -> None:
    late = CAPTURED.joints2d.clone()
    late[:, 1] = SEEN.joints2d[5 : 5 + FRAMES, 1]
    (line,) = told(replace(CAPTURED, joints2d=late))
    assert line.startswith("detections of views [1] look") and "3 frames earlier" in line


@pytest.mark.parametrize("share", [0.0, 0.005, 0.02, 0.05])
def test_right_joints_are_of_the_same_frames(share: float) -> None:
    """Of another detector, off by noise, by the same everywhere or in each joint; smoothed."""
    draw = torch.Generator().manual_seed(0)
    for shape in ((FRAMES, 3, 16, 2), (1, 3, 1, 2), (1, 1, 16, 2)):
        off = share * torch.randn(shape, generator=draw, dtype=CAPTURED.joints2d.dtype)
        assert not any("other frames" in line for line in told(aside(CAPTURED, off)))
    smooth = CAPTURED.joints2d.clone()
    smooth[2:-2] = CAPTURED.joints2d.unfold(0, 5, 1).mean(-1)
    assert not told(replace(CAPTURED, joints2d=smooth))


def test_who_stands_still_and_who_is_unseen_say_nothing() -> None:
    still = CAPTURED.map(lambda part: part[:1].expand_as(part))
    off = 0.01 * torch.randn(still.joints2d.shape, generator=torch.Generator().manual_seed(1))
    assert not told(aside(still, off), still)
    given = SEEN.frames(slice(4, 4 + FRAMES))
    assert not told(replace(given, confidence2d=torch.zeros_like(given.confidence2d)))


def test_learned_joints_may_be_far_from_those_of_the_capture() -> None:
    far = aside(CAPTURED, torch.tensor([0.5, 0.0]))
    assert len(told(far)) == 1
    pixels = far.joints2d.clone().requires_grad_()
    assert not told(Detections.from_joints(pixels, far.confidence2d))
