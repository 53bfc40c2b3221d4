"""Who is found after frames that show nobody may be somebody else."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from takes import detect, make_take, without

from perfcap.pipeline import Stage, capture
from perfcap.pipeline.gap_doubts import gap_doubts

FRAMES, RATE = 40, 30.0


def walked(frames: int = FRAMES) -> torch.Tensor:
    """The way of hips at 1.5 m/s, which turns by and by."""
    angle = torch.linspace(0, 2, frames, dtype=torch.float64)
    step = 1.5 / RATE * torch.stack((angle.cos(), 0 * angle, angle.sin()), -1)
    return step.cumsum(0)


@pytest.mark.parametrize("stop", [17, 18, 22, 28])
def test_whoever_walks_on_is_the_same(stop: int) -> None:
    assert not list(gap_doubts(walked(), [(16, stop)], RATE))
    for ends in ((0, 10), (30, FRAMES)):  # nobody before, or after
        assert not list(gap_doubts(walked(), [ends], RATE))


@pytest.mark.parametrize("stop", [17, 18, 20])
def test_whoever_is_elsewhere_is_not(stop: int) -> None:
    places = walked()
    places[stop:] += torch.tensor([0.5, 0.0, -0.4])
    (told,) = gap_doubts(places, [(16, stop)], RATE)
    assert f"after frames 16 to {stop - 1} (counted from 0)" in told
    assert "is it somebody else?" in told and "0.6" in told


def test_time_enough_for_anything_says_nothing() -> None:
    places = walked()
    places[31:] += torch.tensor([0.9, 0.0, 0.0])
    assert not list(gap_doubts(places, [(16, 31)], RATE))
    assert list(gap_doubts(places, [(16, 31)], 3 * RATE))  # in a third of the time


@pytest.mark.long
def test_captures_name_somebody_else() -> None:
    take = make_take(36, views=3, lifted=False)
    lost = without(take.detections, slice(17, 19))
    arguments = take.actor, take.cameras, lost, take.rate
    right = capture(*arguments, until=Stage.TRACK_MOTION)
    assert right.gaps == ((17, 19),) and not any("somebody else" in w for w in right.warnings)
    aside = take.truth.translation.clone()
    aside[18:] += torch.tensor([0.7, 0.0, 0.0])
    other = detect(take.actor, take.cameras, replace(take.truth, translation=aside), lifted=False)
    found = capture(
        take.actor, take.cameras, without(other, slice(17, 19)), take.rate, until=Stage.TRACK_MOTION
    )
    (told,) = [w for w in found.warnings if "is it somebody else?" in w]
    assert "after frames 17 to 18" in told
