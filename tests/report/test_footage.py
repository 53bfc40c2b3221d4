"""Input videos inside a page."""

from __future__ import annotations

from pathlib import Path

import pytest
from takes import write_video

from perfcap.io.clip import Clip
from perfcap.report.views import encode_view, shown_size


@pytest.mark.parametrize(("frames", "rate"), [(1, 30.0), (2, 240.0), (5, 1000.0)])
def test_short_clips_ask_for_no_more_bits_than_the_encoder_counts(
    tmp_path: Path, frames: int, rate: float
) -> None:
    write_video(tmp_path / "short.mp4", frames, (48, 64), rate)
    clip = Clip.open(tmp_path / "short.mp4")
    (tmp_path / "shown.mp4").write_bytes(encode_view(clip, 0, rate))
    shown = Clip.open(tmp_path / "shown.mp4")
    assert (len(shown), shown.sizes) == (frames, (shown_size((48, 64)),))
    assert shown.fps == pytest.approx(rate, rel=1e-3)
