"""Full turns of the trunk within an instant, as angles smoothed across +-180 degrees make."""

from __future__ import annotations

import math

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.pipeline.motion_spins import spin_doubts

RATE = 30.0
SMOOTHED = torch.tensor([0.8, 0.6, 0.4, 0.2])  # of 360 degrees, by a mean of five frames


def headed(heading: Tensor) -> Tensor:
    """Joints of a moving person who stands with these headings, degrees, (F, 16, 3)."""
    take = make_take(len(heading), turns=0.0)
    position: Tensor = take.actor.skeleton(take.truth).position
    angle = heading.double().deg2rad()
    turn = torch.zeros(len(heading), 3, 3, dtype=torch.float64)
    turn[:, 0, 0] = turn[:, 2, 2] = angle.cos()
    turn[:, 0, 2], turn[:, 2, 0], turn[:, 1, 1] = angle.sin(), -angle.sin(), 1.0
    return position @ turn.mT


@pytest.mark.parametrize("rate", [RATE, 120.0])
def test_smoothed_wraps_are_named(rate: float) -> None:
    heading = torch.full((60,), 178.0)
    heading[30:34] = 178.0 - 356.0 * (1 - SMOOTHED)
    heading[34:] = -178.0
    step = round(rate / RATE)
    slow = torch.nn.functional.interpolate(
        heading[None, None], scale_factor=step, mode="linear", align_corners=True
    )[0, 0]
    (line,) = spin_doubts(headed(slow), rate)
    assert "turns once about within 0.2 s" in line and "Unwrap them" in line


def test_who_dances_is_not() -> None:
    for seconds in (0.4, 0.7):  # a turn: a fast skater's, a dancer's
        phase = (torch.arange(90) / RATE - 1.0) / seconds
        turns = 360.0 * 0.5 * (1 - torch.cos(math.pi * phase.clamp(0, 1)))
        assert not list(spin_doubts(headed(turns), RATE))
    assert not list(spin_doubts(headed(torch.arange(90) * 1800.0 / RATE), RATE))  # goes on
    assert not list(spin_doubts(headed(torch.zeros(6)), RATE))
