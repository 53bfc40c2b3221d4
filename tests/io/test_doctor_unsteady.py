"""Frames that were turned or scaled one by one, and people who turn, come nearer, or are few."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.io.doctor.given import examine_given
from perfcap.io.doctor.unsteady import examine_unsteady

TAKE = make_take(40, lifted=False)
PIXELS = TAKE.detections.joints2d[:, 0]
EVERY = torch.ones(40, 16, dtype=torch.bool)


def about_middle(turn: Tensor, scale: Tensor) -> Tensor:
    """Joints (F, 16, 2) of frames that are turned, radians, and scaled, (F,) each."""
    middle = PIXELS.mean(1, keepdim=True)
    factor = torch.polar(scale, turn)[:, None]
    return middle + torch.view_as_real(factor * torch.view_as_complex(PIXELS - middle))


def varied(degrees: float, share: float, seed: int = 0) -> Tensor:
    draw = torch.Generator().manual_seed(seed)
    turn = torch.deg2rad(degrees * torch.randn(40, generator=draw, dtype=PIXELS.dtype))
    return about_middle(turn, 1 + share * (2 * torch.rand(40, generator=draw).to(turn) - 1))


def told(joints: Tensor, known: Tensor = EVERY) -> list[str]:
    return [found.what for found in examine_unsteady("view", joints, known[: len(joints)])]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("degrees", "share"), [(25, 0), (0, 0.4), (12, 0.25)])
def test_frames_that_were_varied_are_named(degrees: float, share: float, seed: int) -> None:
    (what,) = told(varied(degrees, share, seed))
    assert "from frame to frame, there and back" in what


def test_sound_joints_are_not() -> None:
    assert not told(PIXELS)
    noise = torch.randn(PIXELS.shape, generator=torch.Generator().manual_seed(0))
    size = (PIXELS.amax(1) - PIXELS.amin(1)).amax()
    assert not told(PIXELS + 0.03 * size * noise)  # of the height, in every joint
    assert not told(PIXELS[::5])


def test_who_spins_or_comes_nearer_is_not() -> None:
    time = torch.arange(40, dtype=PIXELS.dtype)
    for turn, scale in ((0.5 * time, 1 + 0 * time), (0 * time, 1.2**time)):
        assert not told(about_middle(turn, scale))


def test_few_joints_or_frames_say_nothing() -> None:
    few = EVERY.clone()
    few[:, 7:] = False
    assert not told(varied(25, 0), few)
    assert not told(varied(25, 0)[:9])


def test_every_way_in_says_so() -> None:
    seen = replace(TAKE.detections, joints2d=varied(12, 0.2)[:, None])
    assert any("there and back" in str(each) for each in examine_given(TAKE.cameras, seen))
