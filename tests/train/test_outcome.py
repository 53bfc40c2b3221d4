"""What is said of a network that has learned nothing, or nothing more."""

from dataclasses import replace

import pytest
import torch
from test_detector_network import CONFIG, Squares

from perfcap.train.detector_task import score_guess
from perfcap.train.outcome import outcome_doubts
from perfcap.train.scenes import Shot

GUESS = {"missed %": 60.0}


class Still(Squares):
    """Crops in which joints are always at the same places."""

    def __getitem__(self, number: int) -> Shot:
        shot = super().__getitem__(number)
        return replace(shot, joints2d=super().__getitem__(0).joints2d)


@pytest.mark.parametrize(
    ("score", "start", "said"),
    [
        (30.0, None, None),
        (30.0, 40.0, None),
        (61.0, None, "no better than the mean of all answers (missed % 61 and 60"),
        (99.0, 40.0, "has learned nothing"),
        (float("nan"), None, "has learned nothing"),
        (40.0, 30.0, "no better than the one it started from (missed % 40 and 30"),
        (30.0, 30.0, "keep that one"),
    ],
)
def test_scores_are_compared(score: float, start: float | None, said: str | None) -> None:
    before = None if start is None else {"missed %": start}
    doubts = [*outcome_doubts({"missed %": score, "MPJPE mm": 1.0}, GUESS, before)]
    assert len(doubts) == (said is not None) and (said is None or said in doubts[0])


def test_a_guess_finds_joints_that_are_always_there() -> None:
    torch.manual_seed(0)
    assert score_guess(Still(), CONFIG)["missed %"] == 0
    assert score_guess(Squares(40), CONFIG)["missed %"] > 20
