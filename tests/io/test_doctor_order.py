"""Frames whose names were sorted as text."""

from __future__ import annotations

import pytest
import torch

import perfcap
from perfcap.io import models_folder
from perfcap.io.doctor.order import examine_order
from perfcap.pipeline.input_doubts import input_doubts

DEMO = models_folder() / "demo"
SEEN = perfcap.read_detections([DEMO / "detections.npz"])[0]


def in_text_order(count: int, first: int) -> torch.Tensor:
    return torch.tensor(sorted(range(first, first + count), key=str)) - first


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("count", [20, 47, 120])
def test_text_order_is_named_and_no_other(count: int, first: int) -> None:
    part = SEEN.frames(slice(count))
    pixels, sure = part.joints2d[:, 0], part.confidence2d[:, 0]
    assert not examine_order("view", pixels, sure)
    assert not examine_order("view", pixels.flip(0), sure.flip(0))
    order = in_text_order(count, first)
    (found,) = examine_order("view", pixels[order], sure[order])
    assert "sorted as text (1, 10, 2)" in found.what


def test_noise_and_few_frames_say_nothing() -> None:
    random = torch.Generator().manual_seed(0)
    still = 300 + 5 * torch.randn(60, 16, 2, generator=random)
    assert not examine_order("view", still, torch.ones(60, 16))
    assert not examine_order("view", still, torch.zeros(60, 16))
    assert not examine_order("view", still[:5], torch.ones(5, 16))


def test_a_capture_says_so() -> None:
    rig = perfcap.read_cameras(DEMO / "camera.json")
    told = input_doubts(rig.cameras, SEEN.frames(in_text_order(60, 1)))
    assert any("sorted as text" in line for line in told)
    assert not any("jump" in line for line in told)
