"""What the card of an adapted network says of how it was learned."""

from pathlib import Path

import pytest

from perfcap.train.card import write_head_card
from perfcap.train.config import TrainHeadConfig


@pytest.mark.parametrize(
    ("steps", "said", "unsaid"),
    [
        (None, "directly alone, not through the solver", "then through the solver"),
        (0, "its weights were dropped", "then through the solver"),
        (15, "then through the solver in 15 steps", "directly alone"),
    ],
)
def test_the_card_says_what_was_done(
    tmp_path: Path, steps: int | None, said: str, unsaid: str
) -> None:
    write_head_card(tmp_path, "net", TrainHeadConfig(), (100, 100), {"shipped, mm": 70.0}, steps)
    text = (tmp_path / "card.md").read_text()
    assert said in text
    assert unsaid not in text
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.parametrize(
    ("frames", "said"),
    [((19, 37), "19 of 37 frames of calibrated"), ((37, 37), " from: 37 frames of calibrated")],
)
def test_the_card_counts_the_frames_that_were_looked_at(
    tmp_path: Path, frames: tuple[int, int], said: str
) -> None:
    write_head_card(tmp_path, "net", TrainHeadConfig(), frames, {"shipped, mm": 70.0}, None)
    text = (tmp_path / "card.md").read_text()
    assert said in text
    assert max(map(len, text.splitlines())) <= 100
