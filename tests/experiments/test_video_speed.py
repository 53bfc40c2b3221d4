"""Time of parts, each without the parts inside it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import video_speed
from video_speed import Clip, Clocks


def test_parts_inside_others_are_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    now = SimpleNamespace(seconds=0.0)
    monkeypatch.setattr(video_speed.time, "process_time", lambda: now.seconds)

    def spend(seconds: float) -> None:
        now.seconds += seconds

    clocks = Clocks(since=0.0)
    inner = clocks.around(spend, "inner")
    network = SimpleNamespace(path=SimpleNamespace(parent=SimpleNamespace(name="thunder")))
    named = clocks.around(lambda session: spend(8.0), "")
    with clocks.part("outer"):
        spend(1.0)
        inner(2.0)
        spend(4.0)
        named(network)
    assert clocks.spent == {"rest": 0.0, "outer": 5.0, "inner": 2.0, "network: thunder": 8.0}
    with pytest.raises(ZeroDivisionError):
        clocks.around(lambda: 1 / 0, "broken")()
    assert clocks.inside == ["rest"]


def test_parts_are_functions_that_there_are() -> None:
    for owner, name, _ in video_speed._PARTS:
        assert callable(getattr(owner, name)), name


def test_writing_does_not_count() -> None:
    runs = [{"lens": 1.0, video_speed._WRITING: 9.0}, {"lens": 3.0}, {"lens": 2.0, "rest": 1.0}]
    found = video_speed._medians(runs, Clip("clip", video_speed.Path("video.mp4"), 10))
    assert found == pytest.approx(
        {"lens": 200.0, "rest": 0.0, video_speed._WRITING: 0.0, "together": 300.0}
    )
