"""Pages of results made in Python: videos of more frames than the capture are named."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest
from reported import FRAMES, SIZE
from takes import write_video

from perfcap.io.result import read_result
from perfcap.pipeline.performance import Performance
from perfcap.report.sources import Places, find_sources


@pytest.mark.parametrize(
    ("more", "first", "named"), [(20, 0, True), (0, 0, False), (5, 0, False), (20, 20, False)]
)
def test_videos_longer_than_the_capture(
    take_performance: Performance,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    more: int,
    first: int,
    named: bool,
) -> None:
    take_performance.save(tmp_path / "result", first)
    videos = (tmp_path / "one.mp4", tmp_path / "two.mp4")
    for path in videos:
        write_video(path, FRAMES + more, SIZE)
    caplog.set_level(logging.WARNING)
    result = read_result(tmp_path / "result")
    sources = find_sources(result, slice(0, FRAMES), Places(videos))
    assert sources.clip is not None and sources.clip.start == first
    said = f"one: has {FRAMES + more} frames, the capture {FRAMES}, and does not say which"
    assert any(said in line for line in sources.notes) == named
    assert any(said in line for line in caplog.messages) == named
