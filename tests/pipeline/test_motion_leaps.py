"""Turns and leaps that no person makes are told, those of dancers are not."""

from __future__ import annotations

import math

import pytest
import torch
from takes import make_take
from torch import Tensor

from perfcap.actor.anatomy import JOINTS
from perfcap.pipeline.motion_leaps import smoothing_doubts, turn_doubts

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
    middle = position[:, JOINTS.index("pelvis")][:, None]
    return (position - middle) @ turn.mT + middle


@pytest.mark.parametrize("rate", [RATE, 120.0])
def test_smoothed_wraps_are_named(rate: float) -> None:
    heading = torch.full((60,), 178.0)
    heading[30:34] = 178.0 - 356.0 * (1 - SMOOTHED)
    heading[34:] = -178.0
    step = round(rate / RATE)
    slow = torch.nn.functional.interpolate(
        heading[None, None], scale_factor=step, mode="linear", align_corners=True
    )[0, 0]
    (line,) = smoothing_doubts(headed(slow), rate)
    words = "joints leap by 0.2 m" if rate == RATE else "turns once about within 0.2 s"
    assert words in line and "Unwrap angles" in line


def test_who_dances_is_not() -> None:
    for seconds in (0.4, 0.7):  # a turn: a fast skater's, a dancer's
        phase = (torch.arange(90) / RATE - 1.0) / seconds
        turns = 360.0 * 0.5 * (1 - torch.cos(math.pi * phase.clamp(0, 1)))
        assert not list(smoothing_doubts(headed(turns), RATE))
    assert not list(smoothing_doubts(headed(torch.arange(90) * 1800.0 / RATE), RATE))  # goes on
    assert not list(smoothing_doubts(headed(torch.zeros(6)), RATE))


def test_limbs_that_go_the_long_way_round() -> None:
    take = make_take(60, turns=0.0)
    right: Tensor = take.actor.skeleton(take.truth).position
    wrong, (shoulder, wrist) = right.clone(), map(JOINTS.index, ("l_shoulder", "l_wrist"))
    for first in (12, 40):  # a full turn of the arm within five frames
        for step, share in enumerate(SMOOTHED.tolist()):
            angle = 2 * math.pi * share
            turn = torch.tensor(
                [
                    [1, 0, 0],
                    [0, math.cos(angle), -math.sin(angle)],
                    [0, math.sin(angle), math.cos(angle)],
                ]
            ).to(right)
            arm = right[first + step, wrist] - right[first + step, shoulder]
            wrong[first + step, wrist] = right[first + step, shoulder] + turn @ arm
    (line,) = smoothing_doubts(wrong, RATE)
    assert "joints leap by 0.2 m or more there and back in frames 1" in line and "Unwrap" in line
    assert not list(smoothing_doubts(right, RATE))
    assert not list(smoothing_doubts(wrong, 10.0))  # at so few frames a second limbs get far


def test_turns_that_nobody_makes_are_told() -> None:
    """Half a turn within a frame; not a pirouette, nor a somersault at few frames a second."""
    spin = torch.zeros(40, 3, dtype=torch.float64)
    spin[:, 1] = torch.arange(40) * 2 * torch.pi * 5.5 / 30  # five and a half turns a second
    assert not list(turn_doubts(spin, 30.0, range(40)))
    assert not list(turn_doubts(2.6 * spin, 12.0, range(40)))
    jump = torch.zeros(40, 3, dtype=torch.float64)
    jump[25:, 1] = torch.pi
    (line,) = turn_doubts(jump, 30.0, range(100, 140))
    assert "by up to 180 degrees within a frame (frames 125)" in line
