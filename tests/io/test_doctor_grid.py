"""Joints that a heat map's cells cut down are named, whatever crops they were found in."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.io.doctor.given import examine_given
from perfcap.io.doctor.grid import examine_grid

TAKE = make_take(40, lifted=False)
PIXELS, SURE = TAKE.detections.joints2d[:, 0], TAKE.detections.confidence2d[:, 0]
HEIGHT = float((PIXELS[..., 1].amax(-1) - PIXELS[..., 1].amin(-1)).median())
CELL = 1.25 * HEIGHT / 64  # of a map that is 64 high, around somebody with some room


def cells(step: Tensor | float, first: Tensor | float = 0.0) -> Tensor:
    return ((PIXELS - first) / step).floor() * step + first


def test_a_grid_of_the_image_is_named() -> None:
    """Steps of 3 % of the person moved what three views saw by three times their error."""
    (found,) = examine_grid("view", cells(0.03 * HEIGHT), SURE)
    assert f"grid of {0.03 * HEIGHT:.3g} px, 3.0%" in found.what


def test_a_grid_of_each_crop_is_named() -> None:
    noise = torch.Generator().manual_seed(0)
    corner = 30 * torch.randn(40, 1, 2, generator=noise, dtype=PIXELS.dtype)
    wide = CELL * (1.05 + 0.1 * torch.rand(40, 1, 1, generator=noise, dtype=PIXELS.dtype))
    for digits in (9, 2):
        (found,) = examine_grid("view", cells(wide, corner).round(decimals=digits), SURE)
        assert "cells of a heat map" in found.what


def test_every_way_in_names_it() -> None:
    def told(joints: Tensor) -> bool:
        seen = replace(TAKE.detections, joints2d=joints[:, None])
        return any("grid" in str(each) for each in examine_given(TAKE.cameras, seen))

    assert told(cells(0.03 * HEIGHT)) and not told(PIXELS)


@pytest.mark.parametrize("digits", [9, 1, 0])
def test_sound_joints_lie_on_none(digits: int) -> None:
    assert not examine_grid("view", PIXELS.round(decimals=digits), SURE)


def test_whole_pixels_of_a_small_person_and_quarters_of_cells_are_none() -> None:
    assert not examine_grid("view", (PIXELS * 80 / HEIGHT).round(), SURE)
    place = PIXELS / CELL
    near = place.floor() + 0.5
    assert not examine_grid("view", (near + 0.25 * torch.sign(place - near)) * CELL, SURE)
