"""What cards of trained networks say went into them."""

import os
from pathlib import Path

import pytest

from perfcap.train.card import last_part, write_detector_card, write_lifter_card
from perfcap.train.config import TrainDetectorConfig, TrainLifterConfig

SOURCES = tuple(f"{number} tracks of well-known videos {number}" for number in range(2, 9))


@pytest.mark.parametrize("kind", ["lifter", "detector"])
def test_cards_say_all_that_went_in_and_the_licence(tmp_path: Path, kind: str) -> None:
    if kind == "lifter":
        scores = {"03": {"MPJPE": 70.0}}
        write_lifter_card(tmp_path, TrainLifterConfig(), ["01"], SOURCES, "CC\n0", scores)
    else:
        scored = {"PCK %": 70.0}
        write_detector_card(
            tmp_path, TrainDetectorConfig(), ["01"], SOURCES, "CC\n0", scored, (30080, 640)
        )
        text = (tmp_path / "card.md").read_text()
        assert "Learned from: 30080 rendered crops" in text
        assert "Scores on 640 rendered crops" in text
    text = (tmp_path / "card.md").read_text()
    assert f"- Went in: {'; '.join(SOURCES)}. - Licence of the weights: CC 0; it" in " ".join(
        text.split()
    )
    assert max(map(len, text.splitlines())) <= 100


def test_sources_are_called_as_they_are_wherever_they_lie(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert last_part("sam") == "sam"
    assert last_part(tmp_path / "some" / "who.glb") == "who.glb"
    assert last_part(f"{tmp_path}/pictures/") == "pictures"
    assert last_part(os.fsdecode(b'/a/b\xff\n"c')) == 'b  "c'  # no UTF-8
    (tmp_path / "pictures" / "inner").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "pictures" / "inner")
    assert last_part(".") == "inner" and last_part("..") == "pictures"
